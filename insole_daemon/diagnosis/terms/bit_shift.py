"""`bit_shift`: a board's digitiser shifts by another number of bits, and activation is 2^k times too large."""

from __future__ import annotations

from collections.abc import Sequence

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from .term import Setting, Term, TermColumns, needs_calibration

STEPS = (-2, -1, 1, 2)  # the real shift less the believed one


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """A column for each step: the wrench of g(a·2^step) − g(a), with more or less of the readings' noise."""
    seen = load.observation
    activation, noise = seen.activation_count, seen.noise_count
    found, before = [], seen.slope_at(activation)
    for step in STEPS:
        times = 2.0**step
        column = load.wrench_of(seen.static_pa(activation * times) - seen.pressure_pa)[..., None]
        more = times * seen.slope_at(activation * times) - before
        echo = -seen.variance_of(before * more * noise**2), seen.variance_of((more * noise) ** 2)
        found.append(TermColumns(({"step": float(step)},), column, echo=(echo[0][..., None], echo[1][..., None])))
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
