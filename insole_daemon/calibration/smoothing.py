"""What is done to the samples before they are fitted, as in Sorrentino et al. 2020, section 4: a Savitzky–Golay filter
of order 5 and frame 41 on counts and reference, and only what changes slowly.

How slow is not published. Here it is half of the reference's range a second: a converter's hold of 20 ms then makes
an error of 1 % of the range. The range of a moment is at least that of the force on an arm of 5 cm, or standing
still would be thrown away for its noise.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.signal import savgol_filter

from .references import ARM_M

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ORDER, FRAME = 5, 41
SLOW = 0.5  # of the range, a second
_GAP = 3.0  # periods: over a longer one nothing is smoothed


def contiguous_stretches(t_s: Array) -> list[slice]:
    """Of at least FRAME samples, without a gap."""
    period_s = float(np.median(np.diff(t_s)))
    cuts = [0, *(np.flatnonzero(np.diff(t_s) > _GAP * period_s) + 1).tolist(), len(t_s)]
    return [slice(a, b) for a, b in pairwise(cuts) if b - a >= FRAME]


def savitzky_golay(x: Array, t_s: Array) -> Array:
    """x (n, …) filtered along its stretches; NaN between them."""
    y = np.full(x.shape, np.nan)
    for rows in contiguous_stretches(t_s):
        y[rows] = savgol_filter(x[rows], FRAME, ORDER, axis=0)
    return y


def far_from(bad: Mask) -> Mask:
    """(n, …) True where no sample within half a frame is bad: what a filter says there has none of it."""
    width = np.ones((FRAME, *(1 for _ in bad.shape[1:])), np.bool_)
    clean: Mask = ~binary_dilation(bad, width)
    return clean


def slow(values: Array, t_s: Array) -> Mask:
    """(n,) where smoothed values (n, c) change slowly; of a shoe f_z comes first, then the moments."""
    kept = np.zeros(len(values), np.bool_)
    span = np.nanmax(values, axis=0) - np.nanmin(values, axis=0)
    span[1:] = np.maximum(span[1:], ARM_M * span[0])
    for rows in contiguous_stretches(t_s):
        rate = np.gradient(values[rows], t_s[rows] + np.arange(len(t_s[rows])) * 1e-12, axis=0)
        kept[rows] = (np.abs(rate) < SLOW * span).all(axis=1)
    return kept & np.isfinite(values).all(axis=1)
