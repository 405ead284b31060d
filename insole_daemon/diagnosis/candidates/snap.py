"""A contact that snaps to at one load and lets go at a lower one: one relay.

Its thresholds move in steps of a cycle's load as they are fitted; the grid of starts is what finds them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...physics.law import Array
from ..candidate import Candidate, Excitation, bounds
from ..operators import relay

UPS = np.geomspace(0.03, 0.9, 15)  # of the span
GAPS = (0.15, 0.3, 0.5, 0.7, 0.9)  # of `up`, to `down`


def candidate(excitation: Excitation) -> Candidate:
    """The candidate for these recordings."""
    span = excitation.span_pa

    def act(x: Array, step_s: float, theta: Array) -> Array:
        up, gap, step = theta
        moved: Array = x + step * span * relay(x, up * span, up * (1 - gap) * span)
        return moved

    def parameters(theta: Array) -> dict[str, Any]:
        up, gap, step = theta
        return {"up_pa": up * span, "down_pa": up * (1 - gap) * span, "step_pa": step * span}

    low, high = bounds((0.01, 1.0), (0.05, 0.98), (0.0, 0.6))
    return Candidate(
        word="snap",
        order=4,
        names=("up", "gap", "step"),
        low=low,
        high=high,
        starts=np.array([(up, gap, 0.03) for up in UPS for gap in GAPS]),
        nudge=np.array([0.01, 0.02, 1e-4]),  # a relay answers to nothing smaller than the distance of two samples
        act=act,
        parameters=parameters,
        scatters=True,
        needs=lambda e: None if e.reversals else "the load never turns back, as a snap needs",
    )
