"""`crosstalk`: the cover spreads load. q = P + k·(mean of the neighbours − P), so P ≈ q + k·(q − mean)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.effects.crosstalk import neighbours
from ...physics.law import Array
from ..model.load import LoadEstimate
from .term import Setting, Term, TermColumns


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """One column: the wrench of q − mean of the neighbours."""
    seen = load.observation
    near = neighbours(seen.layout.xy_m) & seen.usable.ravel()
    weight = near / np.maximum(near.sum(axis=1, keepdims=True), 1)
    pressure = load.pressure_pa.reshape(len(seen.t_s), -1)
    mean = pressure @ weight.T
    moved = np.where(near.any(axis=1), pressure - mean, 0.0)
    return [TermColumns(({},), whole=seen.wrench_of(moved.reshape(load.pressure_pa.shape)).sum(axis=1)[..., None])]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """k."""
    return {"k": float(shares[0])}


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
    limit=0.45,
    misfit=0.03,
    record_instead="an indenter one taxel wide",
    needs=_needs,
)
