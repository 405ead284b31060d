"""Draws the load of a simulation of a trial, which differs from the real one as a model differs from a person."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from .laws import STEP_S
from .ranges import draw, entry
from .trial import Trial


@dataclass(frozen=True)
class SimulatedTrial:
    """A simulation of a trial, on the trial's time, and the simulation's own clock."""

    trial: Trial
    level: str  # none, slight or person
    begin_s: float  # start and end of the part of the trial that it covers
    end_s: float
    offset_s: float  # its clock reads offset_s + (1 + rate) s
    rate: float


def _draw_smooth(rng: np.random.Generator, n: int, columns: int, over_s: float) -> np.ndarray:
    """Draw (n, columns) random numbers of variance 1 that change smoothly over `over_s`."""
    coarse_s = over_s / 4
    step = max(1, round(coarse_s / STEP_S))
    coarse = gaussian_filter1d(rng.standard_normal((n // step + 8, columns)), 4.0, axis=0)
    coarse /= coarse.std(0)
    position = np.arange(n) / step + 2
    return np.stack([np.interp(position, np.arange(len(coarse)), column) for column in coarse.T], 1)


def draw_simulated_trial(rng: np.random.Generator, trial: Trial) -> SimulatedTrial:
    """Draw a simulation of `trial`: errors of timing and distribution, the part it covers, and its clock."""
    levels = entry("simulation", "levels")
    level = list(levels)[int(rng.integers(len(levels)))]
    timing_s, share = float(levels[level]["timing_s"]), float(levels[level]["distribution"])
    n, regions = trial.courses.shape
    if trial.kind == "chamber":
        share *= 0.2  # a regulator follows its set point better than a person does
    time_error_s = timing_s * _draw_smooth(rng, n, 1, 3.0)[:, 0]
    gains = 1 + share * (0.8 * rng.standard_normal(regions) + 0.6 * _draw_smooth(rng, n, regions, 6.0))
    courses = trial.at(trial.courses, trial.seconds + time_error_s) * gains
    is_partial = bool(rng.random() < 0.4)
    length_s = trial.main_s * (rng.uniform(0.6, 0.9) if is_partial else 1.0)
    begin_s = rng.uniform(0, trial.main_s - length_s)
    return SimulatedTrial(
        replace(trial, courses=courses),
        level,
        begin_s,
        begin_s + length_s,
        draw(rng, "simulation", "offset_s"),
        1e-6 * draw(rng, "simulation", "rate_ppm"),
    )
