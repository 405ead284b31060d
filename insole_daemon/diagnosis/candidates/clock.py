"""A reference that is declared to be on the clock of the CAN frames, and is not: it is ahead, or runs at another rate.

A declaration is right to about a millisecond and 20 ppm. Readings that only come late by more are a `delay`.
"""

from __future__ import annotations

import numpy as np

from ...physics.law import Array
from ..candidate import Candidate, Excitation, bounds

DECLARED_RATE = 2e-5  # 1 σ: two quartzes
MOST_RATE = 5.0 * DECLARED_RATE  # 100 ppm, from which on a rate is a finding
STARTS = [[0.02, 0.0], [0.2, 0.0], [-0.05, 0.0], [0.0, 5e-4], [0.0, -5e-4], [0.0, 4e-3], [0.0, -4e-3]]


def candidate(excitation: Excitation) -> Candidate:
    """The candidate for these recordings."""

    def act(x: Array, step_s: float, theta: Array) -> Array:
        rows = np.arange(len(x)) * (1.0 + theta[1]) + theta[0] / step_s
        before = np.clip(np.floor(rows).astype(np.intp), 0, len(x) - 2)
        share = np.clip(rows - before, 0.0, 1.0)[:, None]
        moved: Array = x[before] + share * (x[before + 1] - x[before])
        return moved

    low, high = bounds((-1.0, 1.0), (-0.012, 0.012))
    return Candidate(
        word="clock",
        order=11,
        names=("offset_s", "rate"),
        low=low,
        high=high,
        starts=np.array(STARTS),
        act=act,
        parameters=lambda theta: {"offset_s": float(theta[0]), "rate": float(theta[1])},
        other_word=lambda theta: "delay" if theta[0] < 0 and abs(theta[1]) < MOST_RATE else "clock",
        needs=lambda e: (
            "the reference has a clock of its own: its offset and rate are aligned" if e.own_clock else None
        ),
    )
