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

    Of those that are `believed` (cycles, m), all unless said. Whole numbers make a median coarse; the mean of the
    sizes, without the largest 2 %, is not.
    """
    third = np.abs(np.diff(count, n=3, axis=0)) / np.sqrt(20.0)
    if believed is not None:
        four = believed[3:] & believed[2:-1] & believed[1:-2] & believed[:-3]
        four[:, four.sum(axis=0) < LEAST_DIFFERENCES] = True
        third[~four] = np.nan
    most = np.nanquantile(third, 0.98, axis=0)
    kept = third <= most
    mean = np.sum(np.where(kept, third, 0.0), axis=0) / np.maximum(kept.sum(axis=0), 1)
    found: Array = np.maximum(mean / _MEAN_OF_KEPT, LEAST_COUNT)
    return found


# E|z| of a normal variable without its largest 2 %: (φ(0) − φ(c)) · 2 / 0.98 with P(|z| < c) = 0.98.
_MEAN_OF_KEPT = 2 * (0.398_942_28 - 0.026_652_14) / 0.98
