"""A first-order lag: the whole answer follows with one time constant."""

from __future__ import annotations

import numpy as np

from ...physics.law import Array
from ..candidate import Candidate, Excitation, bounds
from ..operators import low_pass


def candidate(excitation: Excitation) -> Candidate:
    """The candidate for these recordings."""

    def act(x: Array, step_s: float, theta: Array) -> Array:
        return low_pass(x, step_s, float(np.exp(theta[0])))

    low, high = bounds((np.log(2e-3), np.log(1.0)))
    return Candidate(
        word="lag",
        order=6,
        names=("log_tau",),
        low=low,
        high=high,
        starts=np.log(np.geomspace(0.01, 0.6, 6))[:, None],
        act=act,
        parameters=lambda theta: {"tau_s": float(np.exp(theta[0]))},
    )
