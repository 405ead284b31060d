"""`crosstalk`: the cover spreads load. q = P + k·(mean of the neighbours − P), so P ≈ q + k·(q − mean)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.effects.crosstalk import neighbours
from ...physics.law import Array
from ..model.load import LoadEstimate
from .term import Setting, Term, TermColumns

MOST_K = 0.45  # of the law
FURTHER = 5.0  # times the spread of the law


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """One column: the wrench of q − mean of the neighbours."""
    seen = load.observation
    near = neighbours(seen.layout.xy_m) & seen.usable.ravel()
    weight = near / np.maximum(near.sum(axis=1, keepdims=True), 1)
    pressure = load.pressure_pa.reshape(len(seen.t_s), -1)
    mean = pressure @ weight.T
    moved = np.where(near.any(axis=1), pressure - mean, 0.0)
    own = load.wrench_of(moved.reshape(load.pressure_pa.shape))
    if load.is_known:
        # Between triangles less is seen of one step to the neighbours than of a cover that spreads further.
        return [TermColumns(({"times": FURTHER},), by_triangle=FURTHER * own[..., None])]
    return [TermColumns(({"times": 1.0},), whole=own.sum(axis=1)[..., None])]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """k."""
    return {"k": min(float(shares[0]) * settings[0]["times"], MOST_K)}


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
    limit=MOST_K,
    misfit=0.03,
    record_instead="an indenter one taxel wide",
    needs=_needs,
)
