"""Rate-independent hysteresis: weights of play operators over a fixed fan of radii.

With free weights the fan follows whatever loop a material has, and the radii need not be searched for.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...physics.law import Array
from ..candidate import Candidate, Excitation, bounds
from ..operators import plays

RADII = (0.01, 0.02, 0.04, 0.07, 0.12, 0.2, 0.32, 0.45)  # of the span
LEAST_WEIGHT = 2e-3  # of a play that is worth a word in the model
_MOST_KNOWN = 20  # loads whose plays are kept: one a recording


def candidate(excitation: Excitation) -> Candidate:
    """The candidate for these recordings."""
    radii_pa = np.array(RADII) * excitation.span_pa
    fan = _Fan(radii_pa)

    def parameters(theta: Array) -> dict[str, Any]:
        kept = theta > LEAST_WEIGHT
        if not kept.any():
            kept = theta == theta.max()
        return {"r_pa": radii_pa[kept], "w": theta[kept]}

    low, high = bounds(*[(0.0, 1.0)] * len(RADII))
    return Candidate(
        word="hysteresis",
        order=4,
        names=tuple(f"w_{share:g}" for share in RADII),
        low=low,
        high=high,
        starts=np.full((1, len(RADII)), 0.02),
        act=fan,
        parameters=parameters,
        scatters=True,
        needs=lambda e: None if e.reversals else "the load never turns back, as hysteresis needs",
    )


class _Fan:
    """The plays of a load are computed once: it is the same load again and again."""

    def __init__(self, radii_pa: Array) -> None:
        self._radii_pa = radii_pa
        self._known: list[tuple[Array, Array]] = []  # (load, its plays), the newest last

    def __call__(self, x: Array, step_s: float, theta: Array) -> Array:
        loops = next((loops for load, loops in self._known if load is x), None)
        if loops is None:
            loops = plays(x, self._radii_pa)
            self._known = [*self._known[-_MOST_KNOWN:], (x, loops)]
        moved: Array = x + np.tensordot(theta, loops, axes=1)
        return moved
