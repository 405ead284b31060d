"""`preload`: straps press where the reference sees nothing. q = P + p0."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..model.load import LoadEstimate
from .term import Setting, Term, TermColumns


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """One column: the wrench of −1 Pa everywhere."""
    own = load.wrench_of(-np.ones_like(load.slope_pa))[..., None]
    return [TermColumns(({},), by_triangle=own, is_recalibration=True)]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """The pressure in Pa."""
    return {"p0_pa": float(shares[0])}


def _needs(load: LoadEstimate) -> str | None:
    """Why a recording cannot show it."""
    return "a constant load is a part of the static curve here" if load.observation.is_uniform else None


TERM = Term(
    word="preload",
    scopes=("insole", "board", "triangle"),
    share="positive",
    columns=_columns,
    parameters=_parameters,
    plausible=5000.0,
    limit=100000.0,
    needs=_needs,
    record_instead="walking or standing with a force shoe",
)
