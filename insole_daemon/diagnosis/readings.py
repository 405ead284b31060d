"""Readings of cycles as a signal: gaps filled, and all of them at the moments of the cycles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..physics.law import Array


def filled(count: NDArray[np.uint8], valid: NDArray[np.bool_]) -> Array:
    """(n, m) counts, with a straight line in the place of those that are not valid."""
    found = count.astype(np.float64)
    rows = np.arange(len(count))
    for column in np.flatnonzero(~valid.all(axis=0) & valid.any(axis=0)):
        good = valid[:, column]
        found[~good, column] = np.interp(rows[~good], rows[good], found[good, column])
    return found


def together(count: Array, cycle_s: Array, age_s: Array) -> Array:
    """(n, m) counts at the moments of the cycles, between those at which each triangle was read."""
    found = count.copy()
    for column in np.flatnonzero(age_s.any(axis=0)):
        found[:, column] = np.interp(cycle_s, cycle_s - age_s[:, column], count[:, column])
    return found
