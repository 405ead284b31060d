"""Lower bound of the error that remains on walks after the best linear compensation of a lag.

    python -m benchmarks.diagnosis.walking_bound PROOF  # the folder made by `insole prove --suite walking --out PROOF`

It belongs to the row `f_z … against the oracle` of the walking proof, whose oracle reads an insole without the
concealed effect. A lag filters the edges of a step below the noise, so even with the true law the oracle's error cannot
be reached. For every walk with a lag, the true force of the held-out part is filtered by the true lag, sampled every 20
ms, and white noise of the oracle's RMS error is added. The bound is the error of the best linear filter of TAPS
readings and a constant, fitted by least squares to the same true force, with the time stamp of the reading and √(τ · 8
ms) before it, as the daemon stamps.

Takes about a minute, and needs a proof.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]
FINE_S, PERIOD_S = 0.001, 0.02
TAPS = 20
LATE_S = 0.008


def left_n(t_s: Array, fz_n: Array, tau_s: float, noise_n: float) -> tuple[float, float]:
    """RMS that the best filter leaves of a force (n,), N: stamped at the newest reading, and √(τ · LATE_S) earlier."""
    fine_s = np.arange(t_s[0], t_s[-1], FINE_S)
    true_n = np.interp(fine_s, t_s, fz_n)
    k = FINE_S / (2 * tau_s)
    lagged_n = lfilter([k / (1 + k), k / (1 + k)], [1.0, -(1 - k) / (1 + k)], true_n - true_n[0]) + true_n[0]
    every = round(PERIOD_S / FINE_S)
    at_s = fine_s[::every]
    read_n = lagged_n[::every] + np.random.default_rng(0).normal(0.0, noise_n, len(at_s))
    readings = np.lib.stride_tricks.sliding_window_view(read_n, TAPS)
    rows = np.column_stack([readings, np.ones(len(readings))])
    remaining = []
    for late_s in (0.0, float(np.sqrt(tau_s * LATE_S))):
        wanted_n = np.interp(at_s[TAPS - 1 :] - late_s, fine_s, true_n)
        weights = np.linalg.lstsq(rows, wanted_n, rcond=None)[0]
        remaining.append(float(np.sqrt(np.mean((rows @ weights - wanted_n) ** 2))))
    return remaining[0], remaining[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("proof", type=Path)
    proof: Path = parser.parse_args().proof
    scored = {case["case"]: case for case in json.loads((proof / "score.json").read_text())["cases"]}
    rows: dict[str, list[tuple[float, ...]]] = {}
    print("| case | lag | static | oracle | best filter, not late | best filter, late | the daemon |")
    print("|---|---|---|---|---|---|---|")
    for name, case in sorted(scored.items()):
        force = case.get("untouched") if case["recording"] == "walk" else None
        tau_s = [p["true"] for p in case.get("parameters") or () if (p["effect"], p["parameter"]) == ("lag", "tau_s")]
        if not force or not tau_s or force["failure"]:
            continue
        with np.load(proof / "sealed" / name / "scoring.npz") as kept:
            at_once_n, late_n = left_n(kept["t_s"], kept["fz_n"], tau_s[0], force["oracle"])
        row = (force["static"], force["oracle"], at_once_n, late_n, force["model"])
        rows.setdefault(case["kind"], []).append(row)
        cells = " | ".join(f"{value:.1f} N" for value in row)
        print(f"| {case['kind']} {name} | {1e3 * tau_s[0]:.0f} ms | {cells} |")
    for kind, values in rows.items():
        cells = " | ".join(f"{value:.1f} N" for value in np.median(values, axis=0))
        over = np.median([late_n / oracle_n for _, oracle_n, _, late_n, _ in values])
        print(f"| **{kind}, median of {len(values)}** | | {cells} |")
        print(f"\nbest late filter over the oracle, median: {over:.2f} ×\n")


if __name__ == "__main__":
    main()
