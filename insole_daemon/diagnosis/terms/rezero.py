"""`rezero`: a board takes a new baseline, which shifts its later counts. P ≈ q + g′(a)·shift."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from .term import Setting, Term, TermColumns, moments_s


def _column(load: LoadEstimate, setting: Setting) -> TermColumns:
    """Return one column: the wrench of (g(a + shift) − g(a))/shift from the time `t_s` on."""
    since = (load.observation.t_s >= setting["t_s"])[:, None, None]
    shifted = load.shifted_by_triangle(setting.get("shift_count", 0.0))
    return TermColumns((setting,), by_triangle=(shifted * since)[..., None])


def _columns(load: LoadEstimate) -> Iterator[TermColumns]:
    """Yield a column for each moment."""
    return (_column(load, {"t_s": at}) for at in moments_s(load))


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return the time, s, and the shift, counts."""
    return {"t_s": float(settings[0]["t_s"]), "shift_count": float(shares[0])}


TERM = Term(
    word="rezero",
    scopes=("board",),
    share="free",
    columns=_columns,
    parameters=_parameters,
    plausible=5,
    limit=120,
    refine=("t_s",),
    linear_at="shift_count",
    column=_column,
    misfit=0.02,
)
