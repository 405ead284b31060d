"""`baseline`: counts shifted by a constant. P ≈ q + g′(a)·shift, with g the static curve and a the activation."""

from __future__ import annotations

from collections.abc import Sequence

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from .term import Setting, Term, TermColumns, needs_calibration


def _column(load: LoadEstimate, setting: Setting) -> TermColumns:
    """Return one column: the wrench of (g(a + shift) − g(a))/shift."""
    change = load.shifted_by_triangle(setting["shift_count"])[..., None]
    return TermColumns((setting,), by_triangle=change, is_recalibration=True)


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return one column: the wrench of g′(a)."""
    return [_column(load, {"shift_count": 0.0})]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return the shift in counts."""
    return {"shift_count": float(shares[0])}


TERM = Term(
    word="baseline",
    scopes=("insole", "board", "triangle"),
    share="free",
    columns=_columns,
    parameters=_parameters,
    plausible=0.5,
    limit=60,
    linear_at="shift_count",
    column=_column,
    needs=needs_calibration,
)
