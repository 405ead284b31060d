"""Fits and writes the calibration that is handed out: cubics fitted to a chamber recording of the same insole."""

import json
from dataclasses import replace

import numpy as np
from scipy.optimize import nnls

from .chamber import calibration_routine
from .effect import MEMORY, Effect
from .geometry import PRESSURE_TAXELS, Geometry
from .ranges import draw
from .sensor import Sensors
from .signal_path import Signal
from .trial import Trial

_SAMPLE_PERIOD_S = 0.1
DEGREE = 3


def fit_curves(
    rng: np.random.Generator, geometry: Geometry, sensors: Sensors, effects: tuple[Effect, ...], highest_pa: float
) -> tuple[np.ndarray, np.ndarray]:
    """Baselines (28, 12) and coefficients (28, 12, DEGREE + 1) fitted to a calibration recording.

    Of `effects`, the sensor has the memory while it is calibrated. It is empty where users waited at every level,
    or where the memory came later. Each reading is a mean of samples with an error of `calibration_error_count`.
    """
    trial: Trial = calibration_routine(rng, highest_pa)
    memory = tuple(_under_calibration_load(e, trial) for e in effects if e.word in MEMORY)
    columns = np.array([12 * t + k for t in range(28) for k in PRESSURE_TAXELS])
    seconds = np.arange(0, trial.main_s, _SAMPLE_PERIOD_S)
    pressure = trial.at(trial.courses[:, 0], seconds)
    counts = Signal(trial, geometry.taxel_mm, sensors, memory, columns).mean(seconds)
    counts = counts + draw(rng, "insole", "calibration_error_count") * rng.standard_normal(counts.shape)
    is_at_rest = seconds < 5
    baselines, coefficients = np.full(336, np.nan), np.zeros((336, DEGREE + 1))
    for index, column in enumerate(columns):
        baselines[column] = round(float(counts[is_at_rest, index].mean()), 3)
        activation = baselines[column] - counts[:, index]
        # The misfit is minimised in counts, so residuals in Pa are weighted with the sensitivity.
        slope = np.gradient(
            np.polyval(np.polyfit(pressure, activation, 4), np.linspace(0, highest_pa, 200)), highest_pa / 199
        )
        weight = np.interp(pressure, np.linspace(0, highest_pa, 200), slope)
        coefficients[column, 1:] = fit_rising(activation, pressure, weight)
    return baselines.reshape(28, 12), coefficients.reshape(28, 12, DEGREE + 1)


def fit_rising(activation: np.ndarray, pressure: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Coefficients (DEGREE,) of the curve from activation to pressure, without a constant.

    A curve that falls somewhere in its range could not be used: then no coefficient is below 0.
    """
    powers = np.vander(activation, DEGREE + 1, increasing=True)[:, 1:]
    fit = np.linalg.lstsq(powers * weight[:, None], pressure * weight, rcond=None)[0]
    slopes = np.polyval(np.polyder([*fit[::-1], 0.0]), np.linspace(0.0, activation.max(), 100))
    return fit if slopes.min() > 0.0 else nnls(powers * weight[:, None], pressure * weight)[0]


def _under_calibration_load(effect: Effect, trial: Trial) -> Effect:
    """The effect without the departure that was computed for another trial's load."""
    shape = {k: v for k, v in effect.shape.items() if k != "departure"}
    return replace(effect, shape=shape)


def document(geometry: Geometry, baselines: np.ndarray, coefficients: np.ndarray) -> str:
    """Text of the file `calibration.json`, format `insole-calibration/1`."""
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
    content = {"format": "insole-calibration/1", "foot": geometry.foot, "taxels": taxels}
    return json.dumps({**content, "effects": [], "provenance": {}}) + "\n"
