"""Lack of fit: the slow part of a residual beyond white noise, which no selected term describes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from ...physics.law import Array

SLOW_S = (0.2, 1.0, 5.0)  # windows of moving averages: noise averages out, a mismatch does not


@dataclass(frozen=True, slots=True)
class LackOfFit:
    """Mean squares (c,) of a weighted residual in c channels, in variances of the expected noise."""

    noise: Array  # of white noise, from differences of neighbouring rows
    excess: Array  # of the slow part, beyond that of white noise


def lack_of_fit(z: Array, step_s: float, expected: float = 0.0) -> LackOfFit:
    """Return noise and excess of a weighted residual `z` (N, c) with rows every `step_s`.

    noise = mean of (z_{k+1} − z_k)²/2 (von Neumann, Ann. Math. Stat. 12 (1941) 367). excess = the largest, over the
    windows SLOW_S of n rows, of mean(moving average²) − 1.5·noise/n. If the expected mean square of a row,
    `expected`, is above `noise`, the difference is slow noise that the weights account for, and is subtracted.
    """
    noise = np.mean(np.diff(z, axis=0) ** 2, axis=0) / 2.0
    excess = np.zeros(z.shape[1])
    for window_s in SLOW_S:
        size = max(round(window_s / step_s), 3)
        slow = uniform_filter1d(z, size, axis=0)
        excess = np.maximum(excess, np.mean(slow**2, axis=0) - 1.5 * noise / size)
    return LackOfFit(noise, np.maximum(excess - np.maximum(expected - noise, 0.0), 0.0))
