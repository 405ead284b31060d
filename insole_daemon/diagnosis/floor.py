"""Estimate the noise floor of readings from the readings alone.

Third differences remove a smooth signal and multiply the standard deviation of white noise by √20 (Gasser, Sroka &
Jennen-Steinmetz, Biometrika 73 (1986) 625, one order higher). A quantile of their absolute values instead of their mean
square is robust against steps and bursts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..physics.law import Array

_HALF = 0.674_489_75  # median absolute value of a standard normal variable
LEAST_COUNT = 0.3  # standard deviation of rounding alone: 1/√12
LEAST_DIFFERENCES = 50  # for an estimate


def noise_of_blocks(y: Array) -> Array:
    """Return the standard deviation (m,) of the noise in columns of (n, m), whose signal is smooth from row to row."""
    third_difference = np.abs(np.diff(y, n=3, axis=0))
    std: Array = np.median(third_difference, axis=0) / (_HALF * np.sqrt(20.0))
    return std


def noise_of_readings(count: Array, believed: NDArray[np.bool_] | None = None) -> Array:
    """Return the standard deviation (m,) of a reading in `count` (cycles, m), at least that of rounding.

    Only `believed` readings (cycles, m) are used, if given: a repeated reading would have no noise. The mean of
    absolute third differences without the largest 2 % is used, because the median of whole numbers is coarse.
    """
    third_difference = np.full((max(len(count) - 3, 1), count.shape[1]), np.nan)
    for column in range(count.shape[1]):
        readings = count[:, column] if believed is None else count[believed[:, column], column]
        if len(readings) < LEAST_DIFFERENCES + 3:
            readings = count[:, column]
        third_difference[: max(len(readings) - 3, 0), column] = np.abs(np.diff(readings, n=3)) / np.sqrt(20.0)
    largest = np.nanquantile(third_difference, 0.98, axis=0)
    is_used = third_difference <= largest
    mean = np.sum(np.where(is_used, third_difference, 0.0), axis=0) / np.maximum(is_used.sum(axis=0), 1)
    std: Array = np.maximum(mean / _MEAN_OF_KEPT, LEAST_COUNT)
    return std


# E|z| of a normal variable without its largest 2 %: (φ(0) − φ(c)) · 2 / 0.98 with P(|z| < c) = 0.98.
_MEAN_OF_KEPT = 2 * (0.398_942_28 - 0.026_652_14) / 0.98
