"""Baselines that rise by themselves, followed causally: no pressure is negative.

Where the median taxel of a board reads above its baseline, in the mean of some seconds, nothing presses it and the
baseline has moved; the highest it has been seen is what loads are counted from. It is never brought down: what stands
below the baseline may be a load. A board as a whole, since what one taxel does alone is its noise.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array: TypeAlias = NDArray[np.float64]

_SHARE = 0.01  # of a new cycle in the mean: two seconds


def baseline_rise_count(counts: Array, rest_count: Array, board: NDArray[np.intp]) -> Array:
    """(n, m) by how much the baselines `rest_count` (m,) have risen, of `counts` (n, m) on the boards `board` (m,)."""
    by = np.zeros(counts.shape)
    for each in np.unique(board):
        own = board == each
        above = np.median(counts[:, own] - rest_count[own], axis=1)
        mean = lfilter([_SHARE], [1.0, _SHARE - 1.0], above, zi=[(1.0 - _SHARE) * above[0]])[0]
        by[:, own] = np.maximum.accumulate(np.maximum(mean, 0.0))[:, None]
    return by
