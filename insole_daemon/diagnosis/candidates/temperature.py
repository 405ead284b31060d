"""What warmth does to offset and gain: a count and a share of the activation for each kelvin."""

from __future__ import annotations

import numpy as np

from ...physics.law import Array
from ..candidate import Candidate, Excitation, Rows

LEAST_SPAN_K = 0.5


def candidate(excitation: Excitation) -> Candidate:
    """The candidate for these recordings."""

    def columns(rows: Rows, x: Array) -> Array:
        assert rows.temperature_c is not None
        over = (rows.temperature_c - excitation.temperature_c)[:, None]
        found: Array = np.stack([np.broadcast_to(over, x.shape), over * (x + 1)], axis=-1)
        return found

    return Candidate(
        word="temperature",
        order=8,
        columns=columns,
        needs=lambda e: (
            None
            if e.temperature_span_k >= LEAST_SPAN_K
            else f"the temperature stays within {e.temperature_span_k:.1f} K, or is not recorded"
        ),
    )
