"""A rest count that wanders slowly: linear between a few knots."""

from __future__ import annotations

import numpy as np

from ...physics.law import Array
from ..candidate import Candidate, Excitation, Rows

MOST_KNOTS = 9
KNOT_S = 15.0
LEAST_REVERSALS = 5  # fewer, and any memory of so few cycles can be written as drift


def knots_s(seconds: float) -> Array:
    """(k,) from the first frame to the end of a recording."""
    return np.linspace(0.0, seconds, int(np.clip(round(seconds / KNOT_S) + 1, 3, MOST_KNOTS)))


def candidate(excitation: Excitation) -> Candidate:
    """The candidate for these recordings."""

    def columns(rows: Rows, x: Array) -> Array:
        knots = knots_s(rows.seconds)
        # The first hat is left out: with the others and the static curve's constant it says nothing more.
        hats = np.stack([np.interp(rows.t_s, knots, hat) for hat in np.eye(len(knots))[1:]], axis=-1)
        found: Array = np.broadcast_to(hats[:, None, :], (*x.shape, hats.shape[1]))
        return found

    return Candidate(
        word="drift",
        order=8,
        columns=columns,
        own_columns=True,
        needs=lambda e: (
            None
            if e.reversals >= LEAST_REVERSALS
            else f"the load turns {e.reversals} times: memory of one cycle is a slow rise and fall too"
        ),
    )
