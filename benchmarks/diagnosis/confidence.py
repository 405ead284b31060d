"""Logistic regression for the confidence of a finding, fitted to cases of the blind benchmark.

Takes some 10 s a case.

    python -m benchmarks.diagnosis.blind make --suite all --seed N --cases 100 --out cases --sealed sealed
    python -m benchmarks.diagnosis.confidence cases sealed

Use a seed that no other evaluation uses. All findings of a case together have a weight of 1, because they are right or
wrong together. Prints the coefficients for `insole_daemon/diagnosis/select/confidence.py`, and the fraction of correct
findings for each level of confidence.
"""

from __future__ import annotations

import argparse
import json
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from insole_daemon.diagnosis.finding import Finding
from insole_daemon.diagnosis.pipeline import diagnose
from insole_daemon.diagnosis.select.confidence import features, is_of_triangles
from insole_daemon.errors import InsoleError
from insole_daemon.recording.loading import load

PRIOR_STD = 3.0  # of a coefficient
GROUPS = (0.0, 0.5, 0.8, 0.95, 1.0)


def main() -> None:
    """Diagnose the walks of a set, judge the findings, and fit."""
    ask = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    ask.add_argument("cases", type=Path)
    ask.add_argument("sealed", type=Path)
    asked = ask.parse_args()
    truth = json.loads((asked.sealed / "truth.json").read_text())["cases"]
    rows: list[tuple[float, ...]] = []
    right: list[bool] = []
    weights: list[float] = []
    for name, case in sorted(truth.items()):
        accepted = {word for each in case["effects"] for word in each["accept"]} | set(case["equivalent"])
        judged = [
            (
                features(finding.margin, residual_fraction, n_findings, is_of_triangles(finding.effect, finding.where)),
                bool(accepted & {finding.effect, *finding.alternatives}),
            )
            for finding, residual_fraction, n_findings in _findings(asked.cases / name)
            if finding.margin is not None and (finding.effect not in case["tolerated"] or finding.effect in accepted)
        ]
        rows += [x for x, _ in judged]
        right += [observed for _, observed in judged]
        weights += [1.0 / len(judged)] * len(judged)
        sys.stderr.write(f"\r{len(rows)} findings")
    x, y, weight = np.array(rows), np.array(right, float), np.array(weights)
    fitted = fit(x, y, weight * len(weight) / weight.sum())
    probability = 1.0 / (1.0 + np.exp(-x @ fitted))
    print(f"COEFFICIENTS = ({', '.join(f'{c:.2f}' for c in fitted)})  # {len(y)} findings, {int(y.sum())} right")
    base_rate = np.full_like(y, y.mean())
    print(f"log score {_log_score(probability, y):.3f}, of the base rate {_log_score(base_rate, y):.3f}")
    for low, high in pairwise(GROUPS):
        group = (probability >= low) & (probability < high)
        if group.any():
            stated, observed = probability[group].mean(), y[group].mean()
            print(f"{low:.2f} to {high:.2f}: said {stated:.2f}, right {observed:.2f} of {group.sum()}")


def fit(x: NDArray[np.float64], y: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k,) coefficients of the logistic regression of y (n,), 0 or 1, on x (n, k), weighted, with a normal prior."""

    def loss(c: NDArray[np.float64]) -> float:
        z = x @ c
        return float(np.sum(weight * (np.logaddexp(0.0, z) - y * z)) + 0.5 * np.sum((c / PRIOR_STD) ** 2))

    return np.asarray(minimize(loss, np.zeros(x.shape[1])).x)


def _findings(folder: Path) -> list[tuple[Finding, float, int]]:
    """Return the findings of a case, each with the fraction of the mismatch that all leave, and their number."""
    simulated = folder / "simulation"
    try:
        simulations = [load(simulated)] if simulated.exists() else []
        (result,) = diagnose([load(folder / "recording")], None, _silent, simulations).results
    except InsoleError:
        return []
    n_findings = len(result.findings)
    return [(finding, result.figures.residual_fraction, n_findings) for finding in result.findings]


def _silent(text: str) -> None:
    pass


def _log_score(probability: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    p = np.clip(probability, 1e-3, 1 - 1e-3)
    return float(-np.mean(y * np.log(p) + (1 - y) * np.log(1 - p)))


if __name__ == "__main__":
    main()
