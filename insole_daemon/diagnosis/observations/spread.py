"""A load that goes over to neighbouring taxels, step by step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.effects.crosstalk import neighbours
from ...physics.law import Array
from .wrench import WrenchObservation

STEPS = (0, 1, 3, 9)  # over which a cover may spread load: to the next taxels, over a triangle, over a board


def spread(seen: WrenchObservation, load_pa: Array, steps: Sequence[int] = STEPS) -> list[Array]:
    """Loads like `load_pa` (N, T, 12), after each number of steps in which every taxel takes its neighbours' mean."""
    near = neighbours(seen.layout.xy_m) & seen.usable.ravel()
    alone = np.diag(np.where(near.any(axis=1), 0.0, 1.0))
    weight = near / np.maximum(near.sum(axis=1, keepdims=True), 1) + alone
    flat = load_pa.reshape(len(load_pa), -1)
    return [(flat @ np.linalg.matrix_power(weight, each).T).reshape(load_pa.shape) for each in steps]
