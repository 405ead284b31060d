"""Faults that readings show by themselves and that no word of the vocabulary describes: reported as `unknown`.

A bit that never changes, and pick-up that all taxels of a triangle have at once (a hum, folded down by the sampling).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from .readings import TriangleReadings
from .wrench import LARGEST, SMALLEST

N_BITS = 7  # of a count, that can be told: the highest needs more than its range
SPANNED = 4  # times its weight, that a taxel's counts span where a bit has to change
LEAST_INSIDE = 100  # readings between the ends of that span
LEAST_TAXELS = 3  # of a triangle
WINDOW = 8  # readings, less than a step
CALM = 0.25  # quantile over windows: an edge of the load moves all taxels at once, too
LEAST_COUNT2 = 0.05  # of noise, counts²: rounding alone
MOST_TOGETHER, USUAL_TOGETHER = 6.0, 1.5  # of a triangle; of most: independent noise has 1


def stuck_bit(own: TriangleReadings, usable: NDArray[np.bool_]) -> int | None:
    """The bit that is the same in all readings of a triangle although its counts pass both values; None: there is none.

    `usable` (12,): its taxels.
    """
    as_read = own.as_read
    for bit in range(N_BITS):
        weight, agreeing = 1 << bit, 0
        for taxel in np.flatnonzero(usable).tolist():
            counts = own.counts[as_read[:, taxel], taxel].astype(np.int64)
            if not len(counts) or np.ptp(counts) < SPANNED * weight:
                continue
            inside = (counts > counts.min() + weight) & (counts < counts.max() - weight)
            if np.count_nonzero(inside) < LEAST_INSIDE:
                continue
            if np.ptp((counts >> bit) & 1):
                agreeing = 0
                break
            agreeing += 1
        if agreeing >= LEAST_TAXELS:
            return bit
    return None


def never_has(own: TriangleReadings, usable: NDArray[np.bool_], bit: int) -> bool:
    """Whether a bit is the same in all readings of a triangle, however far its counts reach."""
    counts = own.counts[own.as_read & usable].astype(np.int64)
    return bool(len(counts) and not np.ptp((counts >> bit) & 1))


def together(own: TriangleReadings, usable: NDArray[np.bool_]) -> float:
    """Variance of the mean of a triangle's taxels over that of independent ones, of what is fast; NaN: not known."""
    counts = own.counts[:, usable]
    room = ((counts > SMALLEST) & (counts < LARGEST)).mean(axis=0) > 0.5
    n = (len(counts) - 3) // WINDOW
    if room.sum() < LEAST_TAXELS or n < 4:
        return np.nan
    fast = np.diff(counts[:, room], n=3, axis=0)[: n * WINDOW] / np.sqrt(20.0)
    k = fast.shape[1]
    mean = fast.mean(axis=1)
    shared = np.mean(mean.reshape(n, WINDOW) ** 2, axis=1)
    apart = np.mean((fast - mean[:, None]).reshape(n, -1) ** 2, axis=1) * k / (k - 1)
    return float(np.quantile(k * shared / np.maximum(apart, LEAST_COUNT2), CALM))


def pick_up(shares: Array) -> NDArray[np.bool_]:
    """(T,) triangles whose taxels swing at once, by `shares` (T,) as `together` has them.

    None where the load itself moves most of them so.
    """
    known = np.isfinite(shares)
    if not known.any() or float(np.median(shares[known])) > USUAL_TOGETHER:
        return np.zeros(len(shares), bool)
    return np.asarray(known & (np.where(known, shares, 0.0) > MOST_TOGETHER))
