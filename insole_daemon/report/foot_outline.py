"""Compute the outline of an insole around its taxels, as the live page draws it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_DILATE_MM, _ERODE_MM, _STEP_MM = 58.0, 50.0, 1.0
_SMOOTHING_NEIGHBOURS, _SMOOTHING_PASSES = 9, 3  # smoothing: neighbours on each side in the mean, and number of passes


def foot_outline_mm(xy_mm: Array) -> Array:
    """Return the corners (n, 2) of a closed line around points (m, 2), x along the foot.

    The points are dilated by discs and eroded again (morphological closing), so that gaps between patches close.
    """
    rows_mm = np.arange(xy_mm[:, 0].min() - _DILATE_MM, xy_mm[:, 0].max() + _DILATE_MM + _STEP_MM, _STEP_MM)
    left_mm, right_mm = _edge_mm(xy_mm, rows_mm), -_edge_mm(xy_mm * [1.0, -1.0], rows_mm)
    inside = left_mm > right_mm
    line = np.concatenate(
        [
            np.stack([rows_mm, left_mm], axis=1)[inside],
            np.stack([rows_mm, right_mm], axis=1)[inside][::-1],
        ]
    )
    for _ in range(_SMOOTHING_PASSES):
        line = np.mean(
            [np.roll(line, shift, axis=0) for shift in range(-_SMOOTHING_NEIGHBOURS, _SMOOTHING_NEIGHBOURS + 1)], axis=0
        )
    return line


def _edge_mm(xy_mm: Array, rows_mm: Array) -> Array:
    """Return (n,) the extent of the closed shape towards positive y at `rows_mm`; −∞ outside it."""
    dilated = np.max(_reach(rows_mm[:, None] - xy_mm[:, 0], _DILATE_MM) + xy_mm[:, 1], axis=1)
    disc = _reach(np.arange(-_ERODE_MM, _ERODE_MM + _STEP_MM, _STEP_MM), _ERODE_MM)
    padded = np.pad(dilated, len(disc) // 2, constant_values=-np.inf)
    return np.asarray(np.min(np.lib.stride_tricks.sliding_window_view(padded, len(disc)) - disc, axis=1))


def _reach(distance: Array, radius: float) -> Array:
    """Return half the width of a disc at `distance` from its centre; −∞ outside it."""
    square = radius**2 - distance**2
    return np.where(square >= 0, np.sqrt(np.maximum(square, 0.0)), -np.inf)
