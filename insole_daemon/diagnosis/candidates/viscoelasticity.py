"""A standard linear solid: one share of the answer comes late, with one time constant."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...physics.law import Array
from ..candidate import Candidate, Excitation, bounds
from ..operators import low_pass

MOST_SHARE, LAG = 0.8, 0.76  # of the answer that is late; from where on nearly all of it is, as of a lag
SLOWEST_S = 6.0  # one time constant beyond this is what the field calls creep


def candidate(excitation: Excitation) -> Candidate:
    """The candidate for these recordings."""

    def act(x: Array, step_s: float, theta: Array) -> Array:
        share, log_tau = theta
        moved: Array = x + share * (low_pass(x, step_s, float(np.exp(log_tau))) - x)
        return moved

    def parameters(theta: Array) -> dict[str, Any]:
        return {"a": float(theta[0]), "tau_s": float(np.exp(theta[1]))}

    low, high = bounds((0.0, MOST_SHARE), (np.log(0.05), np.log(SLOWEST_S)))
    return Candidate(
        word="viscoelasticity",
        order=5,
        names=("share", "log_tau"),
        low=low,
        high=high,
        starts=np.array([(0.05, log_tau) for log_tau in np.log(np.geomspace(0.08, 5.0, 8))]),
        act=act,
        parameters=parameters,
        scatters=True,
        other_word=lambda theta: "lag" if theta[0] > LAG else "viscoelasticity",
    )
