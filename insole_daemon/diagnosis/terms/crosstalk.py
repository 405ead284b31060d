"""`crosstalk`: the cover spreads load. q = P + k·(mean of the neighbours − P), so P ≈ q + k·(q − mean).

A thick cover spreads further than to the next taxels. Where the load is known, what it takes over further distances
has shares of its own; of these a model, whose law reaches one step, has as much as that law can.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..observations.spread import STEPS, spread
from .term import Setting, Term, TermColumns, in_means

MOST_K = 0.45  # of the law


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """The wrench of q − mean of the neighbours; joint columns of further means where the load is known."""
    steps = STEPS if load.is_known else STEPS[:2]
    found = spread(load.observation, load.pressure_pa, steps)
    own = np.stack([load.wrench_of(near - far) for near, far in pairwise(found)], axis=-1)
    settings = tuple({"steps": float(far)} for far in steps[1:])
    if load.is_known:
        shown = in_means(load, found[0] - found[1])
        return [TermColumns(settings, by_triangle=own, joint=True, in_means=shown)]
    return [TermColumns(settings, whole=own.sum(axis=1))]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """k."""
    return {"k": min(float(np.sum(shares)), MOST_K)}


def _needs(load: LoadEstimate) -> str | None:
    """Why a recording cannot show it."""
    return "under a uniform load every neighbour says the same" if load.observation.is_uniform else None


TERM = Term(
    word="crosstalk",
    scopes=("insole",),
    share="positive",
    columns=_columns,
    parameters=_parameters,
    plausible=0.15,
    limit=2.0,  # the mean after three steps has some of the taxel itself
    is_possible=lambda settings, shares, load_is_known: load_is_known or float(shares[0]) < MOST_K,
    misfit=0.03,
    record_instead="an indenter one taxel wide",
    needs=_needs,
)
