"""Smooth samples and select slow ones before they are fitted, as in Sorrentino et al. 2020, section 4.

The paper uses a Savitzky–Golay filter of order 5 and frame 41 on counts and reference, and only slow changes. How slow
is not published; here it is half of the reference's range per second, so that a converter's hold of 20 ms causes an
error of 1 % of the range. The range of a moment counts as at least the force's range on a lever of 5 cm; otherwise
standing still would be rejected for its noise.
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
SLOW = 0.5  # fraction of the range per second
_GAP = 3.0  # longest gap, in periods, across which samples are smoothed


def contiguous_stretches(t_s: Array) -> list[slice]:
    """Return the intervals without a gap that have at least FRAME samples."""
    period_s = float(np.median(np.diff(t_s)))
    cuts = [0, *(np.flatnonzero(np.diff(t_s) > _GAP * period_s) + 1).tolist(), len(t_s)]
    return [slice(a, b) for a, b in pairwise(cuts) if b - a >= FRAME]


def savitzky_golay(x: Array, t_s: Array) -> Array:
    """Return x (n, …) filtered within each contiguous interval; NaN between them."""
    y = np.full(x.shape, np.nan)
    for rows in contiguous_stretches(t_s):
        y[rows] = savgol_filter(x[rows], FRAME, ORDER, axis=0)
    return y


def is_far_from(is_bad: Mask) -> Mask:
    """Return (n, …) which samples have no bad sample within half a frame, so that the filter used none."""
    width = np.ones((FRAME, *(1 for _ in is_bad.shape[1:])), np.bool_)
    clean: Mask = ~binary_dilation(is_bad, width)
    return clean


def is_slow(values: Array, t_s: Array) -> Mask:
    """Return (n,) where smoothed values (n, c) change slowly; for a shoe the columns are f_z, then the moments."""
    is_selected = np.zeros(len(values), np.bool_)
    span = np.nanmax(values, axis=0) - np.nanmin(values, axis=0)
    span[1:] = np.maximum(span[1:], ARM_M * span[0])
    for rows in contiguous_stretches(t_s):
        rate = np.gradient(values[rows], t_s[rows] + np.arange(len(t_s[rows])) * 1e-12, axis=0)
        is_selected[rows] = (np.abs(rate) < SLOW * span).all(axis=1)
    return is_selected & np.isfinite(values).all(axis=1)
