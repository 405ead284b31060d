"""Errors of estimated parameters if the material follows a law of another family than the one fitted.

    python -m benchmarks.diagnosis.families [--draws 4]

Materials: a snap of nine domains with different thresholds, creep by a power law, a Bouc–Wen loop, a relaxation with a
spectrum of times. Prints the relative errors of the parameters. Those of blind cases are larger, because their
calibrations may contain the effect; `select.amplitude.STD` is theirs.

Takes about 20 minutes.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import insole_daemon
from insole_daemon.diagnosis.operators import low_pass, relay
from insole_daemon.diagnosis.pipeline import diagnose
from tests.diagnosis.chamber import LAYOUT, bouc_wen, write

Array = NDArray[np.float64]
Effect = Callable[[Array, Array], Array]


def snap(rng: np.random.Generator) -> tuple[str, Effect, dict[str, float]]:
    up = rng.uniform(60e3, 140e3)
    down, step, spread = up * rng.uniform(0.4, 0.7), rng.uniform(30e3, 60e3), rng.uniform(0.05, 0.2)
    factors = 1.0 + spread * np.linspace(-1.0, 1.0, 9)

    def effect(t_s: Array, p: Array) -> Array:
        on = np.mean([relay(p[:, None], up * f, down * f)[:, 0] for f in factors], axis=0)
        return p + step * on

    return "snap", effect, {"up_pa": up, "down_pa": down, "step_pa": step}


def creep(rng: np.random.Generator) -> tuple[str, Effect, dict[str, float]]:
    share, exponent, onset_s = rng.uniform(0.05, 0.2), rng.uniform(0.15, 0.35), rng.uniform(0.5, 4.0)

    def effect(t_s: Array, p: Array) -> Array:
        grown = share * ((1 + t_s / onset_s) ** exponent - 1)
        n = 2 * len(p)
        return p + np.fft.irfft(np.fft.rfft(np.diff(p, prepend=0.0), n) * np.fft.rfft(grown, n), n)[: len(p)]

    return "creep", effect, {}


def hysteresis(rng: np.random.Generator) -> tuple[str, Effect, dict[str, float]]:
    return "hysteresis", bouc_wen(rng.uniform(0.2, 0.6), rng.uniform(30e3, 90e3)), {}


def viscoelasticity(rng: np.random.Generator) -> tuple[str, Effect, dict[str, float]]:
    a, tau_s, width = rng.uniform(0.15, 0.4), np.exp(rng.uniform(np.log(0.3), np.log(2.0))), rng.uniform(0.1, 0.3)
    taus = tau_s * np.exp(width * np.linspace(-1.5, 1.5, 7))

    def effect(t_s: Array, p: Array) -> Array:
        late = np.mean([low_pass(p[:, None], float(t_s[1] - t_s[0]), float(tau))[:, 0] for tau in taus], axis=0)
        return (1 - a) * p + a * late

    return "viscoelasticity", effect, {"a": a, "tau_s": tau_s}


def fraction(p: Array, q: Array) -> float:
    """Half the peak-to-peak of what no cubic of the load makes of the effect, over the span."""
    basis = np.vander(p / p.max(), 4)
    return float(np.ptp(q - basis @ np.linalg.lstsq(basis, q, rcond=None)[0]) / np.ptp(q) / 2)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=4)
    off: dict[str, list[float]] = {}
    for draw in range(parser.parse_args().draws):
        for make in (snap, creep, hysteresis, viscoelasticity):
            rng = np.random.default_rng([draw, len(off)])
            word, effect, true = make(rng)
            seen: list[tuple[Array, Array]] = []

            def watched(t_s: Array, p: Array, effect: Effect = effect, seen: list = seen) -> Array:
                seen.append((p, effect(t_s, p)))
                return seen[-1][1]

            strength = rng.normal(1.0, 0.1, len(LAYOUT) * 12)
            with tempfile.TemporaryDirectory() as folder:
                recording = insole_daemon.load(write(Path(folder) / "trial", watched, strength, seed=draw))
                diagnosis = diagnose([recording], None, lambda text: None)
            if word != "snap":
                true = {**true, "amplitude_fraction": fraction(*seen[0])}
            findings = [each for each in diagnosis.findings if each.effect == word]
            print(word, sorted(each.effect for each in diagnosis.findings))
            for name, value in true.items() if findings else ():
                parameter = findings[0].parameters[name]
                off.setdefault(f"{word} {name}", []).append(float(parameter.value) / value - 1)
                print(f"  {name}: {value:.4g} true, {float(parameter.value):.4g} ± {float(parameter.std):.2g}")
    for name, errors in off.items():
        print(f"{name}: {np.mean(errors):+.1%} ± {np.std(errors):.1%}, RMS {np.sqrt(np.mean(np.square(errors))):.1%}")


if __name__ == "__main__":
    main()
