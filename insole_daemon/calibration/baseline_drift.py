"""Follow rising baselines causally, using that no pressure is negative.

If the median taxel of a board reads above its baseline for some seconds, nothing presses it and the baseline has moved;
loads are counted from the highest level seen. The level is never lowered, because a reading below the baseline may be a
load. Boards are followed as a whole: what a single taxel does alone is noise.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array: TypeAlias = NDArray[np.float64]

_SHARE = 0.01  # weight of a new cycle in the exponential mean, about 2 s at 50 Hz


def baseline_rise_count(counts: Array, rest_count: Array, board: NDArray[np.intp]) -> Array:
    """Return (n, m) the rise of the baselines `rest_count` (m,), from `counts` (n, m) on the boards `board` (m,)."""
    rise = np.zeros(counts.shape)
    for address in np.unique(board):
        of_board = board == address
        above = np.median(counts[:, of_board] - rest_count[of_board], axis=1)
        mean = lfilter([_SHARE], [1.0, _SHARE - 1.0], above, zi=[(1.0 - _SHARE) * above[0]])[0]
        rise[:, of_board] = np.maximum.accumulate(np.maximum(mean, 0.0))[:, None]
    return rise
