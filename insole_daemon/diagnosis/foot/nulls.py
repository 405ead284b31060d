"""What the best of all effects explains where nothing is there: nulls made of these very walks.

A null is what the static model says of these rows, with white noise on both sides that went through the same kernel.
Directions are those of the static model, so a hundred nulls cost one projection; each is explained by the best single
effect on the rows it is fitted to, which gives noise more than held-out steps would (White, Econometrica 68 (2000)
1097).
"""

from __future__ import annotations

import numpy as np

from ...physics.law import Array
from .evidence import Evidence
from .hypothesis import Hypothesis
from .part import EVERY, white

N_NULLS = 60
LEAST_PRICE = 0.05  # of the noise's mean square: what a symmetric smoother of the reference still earns, measured
_LAG_S, _LATE_S = 0.015, (0.1, 0.4, 1.5)


def gains(evidence: Evidence, seed: int = 0) -> Array:
    """(N_NULLS,) mean square that the best single effect takes away, in units of the noise."""
    rng = np.random.default_rng(seed)
    drawn = [white(rng, (len(p.rows_s) * EVERY, 3, N_NULLS), p.walk.step_s)[::EVERY] for p in evidence.parts]
    noise = evidence.rid(np.concatenate(drawn).astype(np.float64), None)
    static = Hypothesis(evidence, ())
    clocks = static.clocks(static.fit().theta)
    plain, boards = evidence.said.target(clocks, 0.0, 0.0), evidence.boards
    effects = [
        (evidence.said.target(clocks, 0.0, _LAG_S) - plain)[..., None],
        evidence.said.late(boards, 1e-3)[..., None],
        np.stack([evidence.said.late(boards, tau_s) for tau_s in _LATE_S], axis=-1),
        evidence.said.loops(boards),
    ]
    explained = []
    for directions in effects:
        basis = np.linalg.qr(evidence.rid(directions, None))[0]
        explained.append(np.sum((basis.T @ noise) ** 2, axis=0))
    found: Array = np.max(explained, axis=0) / (3 * int(evidence.asked.sum()))
    return found


def price(found: Array) -> float:
    """Of one more effect: more than the best of all gives in 99 of 100 nulls."""
    return max(float(np.quantile(found, 0.99)), LEAST_PRICE)
