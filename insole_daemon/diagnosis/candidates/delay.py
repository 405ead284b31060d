"""Readings that arrive late. Where the reference has a clock of its own it cannot be told from the clocks' offset."""

from __future__ import annotations

import numpy as np

from ...physics.law import Array
from ..candidate import Candidate, Excitation, bounds


def candidate(excitation: Excitation) -> Candidate:
    """The candidate for these recordings."""

    def act(x: Array, step_s: float, theta: Array) -> Array:
        rows = np.arange(len(x)) - theta[0] / step_s
        before = np.clip(np.floor(rows).astype(np.intp), 0, len(x) - 1)
        after = np.minimum(before + 1, len(x) - 1)
        share = np.clip(rows - before, 0.0, 1.0)[:, None]
        late: Array = x[before] + share * (x[after] - x[before])
        return late

    low, high = bounds((0.0, 1.0))
    return Candidate(
        word="delay",
        order=10,
        names=("delay_s",),
        low=low,
        high=high,
        starts=np.array([[0.01], [0.05], [0.2]]),
        act=act,
        parameters=lambda theta: {"delay_s": float(theta[0])},
        needs=lambda e: (
            "the reference has a clock of its own, whose offset a delay cannot be told from" if e.own_clock else None
        ),
    )
