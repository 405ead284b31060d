"""Creep: a share of the answer that goes on for decades of time.

The spectrum of time constants is smooth: a_k ∝ τ_k^tilt from `shortest` to `longest`. A tilt of 0 is growth with the
logarithm of time, between 0 and 1 a power law. It always goes on for tens of seconds: what is over sooner is no creep.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...physics.law import Array
from ..candidate import Candidate, Excitation, bounds
from ..operators import low_pass
from .viscoelasticity import SLOWEST_S

PER_DECADE = 2
SHORTEST_S, LONGEST_S = 0.1, 1000.0
LEAST_LONGEST_S = 20.0
NARROW = np.log(4.0)  # standard deviation of the logarithm of τ: a spectrum that is one time constant, smeared
LEAST_WIDTH = np.log(4.0)  # of the spectrum: narrower, and its edges would swap places
LEAST_SHARE = 2e-3  # of all shares together: less is not worth a mode in the model


def candidate(excitation: Excitation) -> Candidate:
    """The candidate for these recordings; what is slower than they are long is one ramp, and left out."""
    longest_s = max(min(LONGEST_S, 4 * excitation.seconds), 2 * LEAST_LONGEST_S)
    n = 1 + round(PER_DECADE * np.log10(longest_s / SHORTEST_S))
    tau_s = np.geomspace(SHORTEST_S, longest_s, n)
    log_least_longest = np.log(LEAST_LONGEST_S)

    def shares(theta: Array) -> Array:
        share, log_shortest, reach, tilt = theta
        least = max(log_least_longest, log_shortest + LEAST_WIDTH)
        log_longest = least + reach * (np.log(longest_s) - least)
        # The edges of the spectrum are soft, so that moving them moves the answer smoothly.
        edge = 1.0 / (1.0 + np.exp(-4.0 * (np.log(tau_s) - log_shortest)))
        edge /= 1.0 + np.exp(4.0 * (np.log(tau_s) - log_longest))
        weight = edge * np.exp(tilt * (np.log(tau_s) - np.log(tau_s[-1])))
        found: Array = share * weight / weight.sum()
        return found

    def act(x: Array, step_s: float, theta: Array) -> Array:
        moved = x.copy()
        for share, tau in zip(shares(theta), tau_s, strict=True):
            if share > LEAST_SHARE * theta[0]:
                moved += share * (low_pass(x, step_s, float(tau)) - x)
        return moved

    def parameters(theta: Array) -> dict[str, Any]:
        each = shares(theta)
        kept = each > LEAST_SHARE * theta[0]
        return {"a": each[kept], "tau_s": tau_s[kept]}

    def other_word(theta: Array) -> str:
        each, log_tau = shares(theta) / max(theta[0], 1e-9), np.log(tau_s)
        middle = float(each @ log_tau)
        width = float(np.sqrt(each @ (log_tau - middle) ** 2))
        return "viscoelasticity" if width < NARROW and middle < np.log(SLOWEST_S) else "creep"

    low, high = bounds(
        (0.0, 0.8),
        (np.log(0.1), np.log(min(60.0, longest_s / 4))),
        (0.0, 1.0),
        (-0.4, 0.9),
    )
    starts = [
        (0.05, np.log(shortest), reach, tilt)
        for shortest in (0.2, 1.0, 5.0, 15.0)
        for reach in (0.0, 1.0)
        for tilt in (0.0, 0.3)
        if 2 * shortest < longest_s / 4
    ]
    return Candidate(
        word="creep",
        order=5,
        names=("share", "log_shortest", "reach", "tilt"),
        low=low,
        high=high,
        starts=np.array(starts),
        act=act,
        parameters=parameters,
        scatters=True,
        other_word=other_word,
        needs=lambda e: None if e.seconds >= 20 else "creep needs a recording of 20 s or longer, with a hold",
    )
