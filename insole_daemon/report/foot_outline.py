"""The outline of an insole around its taxels, as the live page draws it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SWEPT_MM, _SHRUNK_MM, _STEP_MM = 58.0, 50.0, 1.0
_ROUNDED, _ROUNDS = 9, 3  # neighbours on each side that a point is averaged with, and how often


def foot_outline_mm(xy_mm: Array) -> Array:
    """Return the corners (n, 2) of a closed line around points (m, 2), x along the foot.

    The points are swept by discs and shrunk again, so that gaps between patches close.
    """
    rows_mm = np.arange(xy_mm[:, 0].min() - _SWEPT_MM, xy_mm[:, 0].max() + _SWEPT_MM + _STEP_MM, _STEP_MM)
    left_mm, right_mm = _edge_mm(xy_mm, rows_mm), -_edge_mm(xy_mm * [1.0, -1.0], rows_mm)
    inside = left_mm > right_mm
    line = np.concatenate(
        [
            np.stack([rows_mm, left_mm], axis=1)[inside],
            np.stack([rows_mm, right_mm], axis=1)[inside][::-1],
        ]
    )
    for _ in range(_ROUNDS):
        line = np.mean([np.roll(line, shift, axis=0) for shift in range(-_ROUNDED, _ROUNDED + 1)], axis=0)
    return line


def _edge_mm(xy_mm: Array, rows_mm: Array) -> Array:
    """(n,) how far the closed shape reaches to positive y at `rows_mm`; −∞ beyond it."""
    swept = np.max(_reach(rows_mm[:, None] - xy_mm[:, 0], _SWEPT_MM) + xy_mm[:, 1], axis=1)
    disc = _reach(np.arange(-_SHRUNK_MM, _SHRUNK_MM + _STEP_MM, _STEP_MM), _SHRUNK_MM)
    padded = np.pad(swept, len(disc) // 2, constant_values=-np.inf)
    return np.asarray(np.min(np.lib.stride_tricks.sliding_window_view(padded, len(disc)) - disc, axis=1))


def _reach(distance: Array, radius: float) -> Array:
    """Half the width of a disc at `distance` from its centre; −∞ beyond it."""
    square = radius**2 - distance**2
    return np.where(square >= 0, np.sqrt(np.maximum(square, 0.0)), -np.inf)
