"""The play operator on any shape of courses."""

from __future__ import annotations

import numpy as np

from ...physics.law import Array


def play_operator(x: Array, radius_pa: float) -> Array:
    """(N, ...) y_n = max(x_n − r, min(x_n + r, y_(n−1))), y = 0 before the first row."""
    found = np.empty_like(x)
    last = np.zeros(x.shape[1:])
    for row, low, high in zip(found, x - radius_pa, x + radius_pa, strict=True):
        last = np.maximum(np.minimum(last, high, out=row), low, out=row)
    return found
