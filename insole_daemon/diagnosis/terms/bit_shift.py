"""`bit_shift`: a board's digitiser shifts by another number of bits, and activation is 2^k times too large."""

from __future__ import annotations

from collections.abc import Sequence

from ...physics.law import Array
from ..model.load import LoadEstimate
from .term import Setting, Term, TermColumns, needs_calibration

STEPS = (-2, -1, 1, 2)  # the real shift less the believed one


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """A column for each step: the wrench of g(a·2^step) − g(a)."""
    seen = load.observation
    found = []
    for step in STEPS:
        pressure = seen.static_pa(seen.activation_count * 2.0**step)
        found.append(TermColumns(({"step": float(step)},), load.wrench_of(pressure - seen.pressure_pa)[..., None]))
    return found


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """By how much the real shift differs; the board's own shift is added where it is known."""
    return {"shift": int(settings[0]["step"])}


TERM = Term(
    word="bit_shift",
    scopes=("board", "insole"),
    share="whole",
    columns=_columns,
    parameters=_parameters,
    needs=needs_calibration,
)
