"""The load that a simulation of a trial believes in: a person never loads an insole as a model does."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from .laws import STEP_S
from .ranges import draw, entry
from .trial import Trial


@dataclass(frozen=True)
class Believed:
    """A simulated trial beside the real one, in the real one's time, and the simulation's own clock."""

    trial: Trial
    level: str  # none, slight or person
    begin_s: float  # the part of the trial that it covers
    end_s: float
    offset_s: float  # its clock reads offset_s + (1 + rate) s
    rate: float


def _smooth(rng: np.random.Generator, n: int, columns: int, over_s: float) -> np.ndarray:
    """(n, columns) of random numbers of variance 1 that change over `over_s`."""
    coarse_s = over_s / 4
    step = max(1, round(coarse_s / STEP_S))
    few = gaussian_filter1d(rng.standard_normal((n // step + 8, columns)), 4.0, axis=0)
    few /= few.std(0)
    position = np.arange(n) / step + 2
    return np.stack([np.interp(position, np.arange(len(few)), c) for c in few.T], 1)


def believed(rng: np.random.Generator, trial: Trial) -> Believed:
    """Draw what a simulation believes of a trial."""
    levels = entry("simulation", "levels")
    level = list(levels)[int(rng.integers(len(levels)))]
    timing_s, share = float(levels[level]["timing_s"]), float(levels[level]["distribution"])
    n, regions = trial.courses.shape
    if trial.kind == "chamber":
        share *= 0.2  # a regulator follows its set point better than a person does
    warp = timing_s * _smooth(rng, n, 1, 3.0)[:, 0]
    gains = 1 + share * (0.8 * rng.standard_normal(regions) + 0.6 * _smooth(rng, n, regions, 6.0))
    courses = trial.at(trial.courses, trial.seconds + warp) * gains
    part = bool(rng.random() < 0.4)
    length = trial.main_s * (rng.uniform(0.6, 0.9) if part else 1.0)
    begin = rng.uniform(0, trial.main_s - length)
    return Believed(
        replace(trial, courses=courses),
        level,
        begin,
        begin + length,
        draw(rng, "simulation", "offset_s"),
        1e-6 * draw(rng, "simulation", "rate_ppm"),
    )
