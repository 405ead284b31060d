"""Spread a load to neighbouring taxels, step by step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.effects.crosstalk import neighbours
from ...physics.law import Array
from .wrench import WrenchObservation

STEPS = (0, 1, 3, 9)  # that are searched: to the next taxels, over a triangle, over a board


def spread(seen: WrenchObservation, load_pa: Array, steps: Sequence[int] = STEPS) -> list[Array]:
    """Return loads like `load_pa` (N, T, 12), for each number of steps in which a taxel takes its neighbours' mean."""
    is_neighbour = neighbours(seen.layout.xy_m) & seen.usable.ravel()
    without_neighbour = np.diag(np.where(is_neighbour.any(axis=1), 0.0, 1.0))
    weight = is_neighbour / np.maximum(is_neighbour.sum(axis=1, keepdims=True), 1) + without_neighbour
    flat = load_pa.reshape(len(load_pa), -1)
    return [(flat @ np.linalg.matrix_power(weight, n_steps).T).reshape(load_pa.shape) for n_steps in steps]
