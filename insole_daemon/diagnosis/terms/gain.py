"""`gain`: activation scaled. P ≈ q − g′(a)·a·(gain − 1), g the static curve and a the activation."""

from __future__ import annotations

from collections.abc import Sequence

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from .term import Setting, Term, TermColumns, needs_calibration

STRONG_LOSS = -0.5


def _column(load: LoadEstimate, setting: Setting) -> TermColumns:
    """Return one column: the wrench of (g(a/(1 + more)) − g(a))/more, or its limit −g′(a)·a for `more` near 0."""
    more = max(setting["more"], -0.8)
    activation = load.activation_count
    if abs(more) < 1e-3:
        return TermColumns(
            (setting,), by_triangle=load.wrench_of(-load.slope_pa * load.gained_count)[..., None], is_recalibration=True
        )
    changed = (load.static_pa(activation / (1.0 + more)) - load.read_pa) / more
    return TermColumns((setting,), by_triangle=load.wrench_of(changed)[..., None], is_recalibration=True)


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return the wrench of −g′(a)·a; from readings also that of a strong loss, of which this is no approximation."""
    return [_column(load, {"more": more}) for more in ((0.0,) if load.is_known else (0.0, STRONG_LOSS))]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return the gain."""
    return {"gain": 1.0 + float(shares[0])}


TERM = Term(
    word="gain",
    scopes=("insole", "board", "triangle"),
    share="free",
    columns=_columns,
    parameters=_parameters,
    plausible=0.05,
    limit=0.9,
    linear_at="more",
    column=_column,
    needs=needs_calibration,
)
