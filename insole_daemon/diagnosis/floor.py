"""The noise floor: what of a reading no model could know, from the readings themselves.

Third differences remove what changes smoothly and leave √20 times the standard deviation of white noise (Gasser, Sroka
& Jennen-Steinmetz, Biometrika 73 (1986) 625, one order higher). A quantile of their size instead of the mean square
keeps steps and bursts out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..physics.law import Array

_HALF = 0.674_489_75  # of a normal variable's sizes are below this many standard deviations
LEAST_COUNT = 0.3  # rounding alone: 1/√12
LEAST_DIFFERENCES = 50  # to tell a noise from


def noise_of_blocks(y: Array) -> Array:
    """(m,) standard deviation of the noise of the rows of (n, m), whose signal is smooth from row to row."""
    third = np.abs(np.diff(y, n=3, axis=0))
    found: Array = np.median(third, axis=0) / (_HALF * np.sqrt(20.0))
    return found


def noise_of_readings(count: Array, believed: NDArray[np.bool_] | None = None) -> Array:
    """(m,) standard deviation of a single reading of (cycles, m) counts: at least what rounding makes.

    Of those that are `believed` (cycles, m), all unless said, each beside the next that is: a repeated reading would
    have no noise. Whole numbers make a median coarse; the mean of the sizes, without the largest 2 %, is not.
    """
    third = np.full((max(len(count) - 3, 1), count.shape[1]), np.nan)
    for column in range(count.shape[1]):
        own = count[:, column] if believed is None else count[believed[:, column], column]
        if len(own) < LEAST_DIFFERENCES + 3:
            own = count[:, column]
        third[: max(len(own) - 3, 0), column] = np.abs(np.diff(own, n=3)) / np.sqrt(20.0)
    most = np.nanquantile(third, 0.98, axis=0)
    kept = third <= most
    mean = np.sum(np.where(kept, third, 0.0), axis=0) / np.maximum(kept.sum(axis=0), 1)
    found: Array = np.maximum(mean / _MEAN_OF_KEPT, LEAST_COUNT)
    return found


# E|z| of a normal variable without its largest 2 %: (φ(0) − φ(c)) · 2 / 0.98 with P(|z| < c) = 0.98.
_MEAN_OF_KEPT = 2 * (0.398_942_28 - 0.026_652_14) / 0.98
