"""`crosstalk`: the cover spreads load. q = P + k·(mean of the neighbours − P), so P ≈ q + k·(q − mean).

A thick cover spreads load beyond the neighbouring taxels. If the load is known, further distances have columns of their
own. The law of the exported model reaches only the neighbours; its k is the sum of all shares, at most MOST_K.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..observations.spread import STEPS, spread
from .term import Setting, Term, TermColumns, in_means

MOST_K = 0.45  # largest k of the law


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return the wrench of q − mean of the neighbours; if the load is known, joint columns for further distances."""
    steps = STEPS if load.is_known else STEPS[:2]
    means = spread(load.observation, load.pressure_pa, steps)
    columns = np.stack([load.wrench_of(near - far) for near, far in pairwise(means)], axis=-1)
    settings = tuple({"steps": float(far)} for far in steps[1:])
    if load.is_known:
        shown = in_means(load, means[0] - means[1])
        return [TermColumns(settings, by_triangle=columns, joint=True, in_means=shown)]
    return [TermColumns(settings, whole=columns.sum(axis=1))]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return k."""
    return {"k": min(float(np.sum(shares)), MOST_K)}


def _needs(load: LoadEstimate) -> str | None:
    """Return the reason why a recording cannot show the effect."""
    return "under a uniform load all neighbours bear the same load" if load.observation.is_uniform else None


TERM = Term(
    word="crosstalk",
    scopes=("insole",),
    share="positive",
    columns=_columns,
    parameters=_parameters,
    plausible=0.15,
    limit=2.0,  # above 1: a mean over three steps contains the taxel itself
    is_possible=lambda settings, shares, load_is_known: load_is_known or float(shares[0]) < MOST_K,
    misfit=0.03,
    record_instead="an indenter one taxel wide",
    needs=_needs,
)
