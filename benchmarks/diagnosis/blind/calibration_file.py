"""The calibration a user has: polynomials fitted to a chamber recording of this insole, memory and all, or without."""

import json
from dataclasses import replace

import numpy as np

from .chamber import calibration_routine
from .effect import MEMORY, Effect
from .geometry import PRESSURE_TAXELS, Geometry
from .ranges import draw
from .sensor import Sensors
from .signal_path import Signal
from .trial import Trial

_EVERY_S = 0.1
DEGREE = 3


def believed_curves(
    rng: np.random.Generator, geometry: Geometry, these: Sensors, effects: tuple[Effect, ...], highest_pa: float
) -> tuple[np.ndarray, np.ndarray]:
    """Baselines (28, 12) and coefficients (28, 12, DEGREE + 1) fitted to a calibration recording.

    effects: the memory the sensor had when it was calibrated; none where users waited at every level, or where the
    memory came later. Readings are averages of as many samples as give an error of `calibration_error_count`.
    """
    trial: Trial = calibration_routine(rng, highest_pa)
    memory = tuple(_in_the_chamber(e, trial) for e in effects if e.word in MEMORY)
    columns = np.array([12 * t + k for t in range(28) for k in PRESSURE_TAXELS])
    seconds = np.arange(0, trial.main_s, _EVERY_S)
    pressure = trial.at(trial.courses[:, 0], seconds)
    counts = Signal(trial, geometry.taxel_mm, these, memory, columns).mean(seconds)
    counts = counts + draw(rng, "insole", "calibration_error_count") * rng.standard_normal(counts.shape)
    at_rest = seconds < 5
    baselines, coefficients = np.full(336, np.nan), np.zeros((336, DEGREE + 1))
    for c, column in enumerate(columns):
        baselines[column] = round(float(counts[at_rest, c].mean()), 3)
        a = baselines[column] - counts[:, c]
        # Weights: the misfit that counts is one in counts, so pressure is weighted with the sensitivity.
        slope = np.gradient(np.polyval(np.polyfit(pressure, a, 4), np.linspace(0, highest_pa, 200)), highest_pa / 199)
        weight = np.interp(pressure, np.linspace(0, highest_pa, 200), slope)
        powers = np.vander(a, DEGREE + 1, increasing=True)[:, 1:]
        found = np.linalg.lstsq(powers * weight[:, None], pressure * weight, rcond=None)[0]
        coefficients[column, 1:] = found
    return baselines.reshape(28, 12), coefficients.reshape(28, 12, DEGREE + 1)


def _in_the_chamber(effect: Effect, trial: Trial) -> Effect:
    """The same material under the calibration's load."""
    shape = {k: v for k, v in effect.shape.items() if k != "departure"}
    return replace(effect, shape=shape)


def document(geometry: Geometry, baselines: np.ndarray, coefficients: np.ndarray) -> str:
    """`insole-calibration/1`."""
    taxels = [
        {
            "board": int(geometry.address[t]),
            "triangle": int(geometry.slot[t]),
            "taxel": k,
            "baseline_count": float(baselines[t, k]),
            "coefficients_pa": [float(f"{c:.7g}") for c in coefficients[t, k]],
        }
        for t in range(28)
        for k in PRESSURE_TAXELS
    ]
    found = {"format": "insole-calibration/1", "foot": geometry.foot, "taxels": taxels}
    return json.dumps({**found, "effects": [], "provenance": {}}) + "\n"
