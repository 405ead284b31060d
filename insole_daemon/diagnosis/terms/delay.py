"""`delay`: readings are late by a constant time d. c(t) ← c(t − d)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..observations.interpolated_noise import noise_echo
from ..operators import cubic_at
from .term import Setting, Term, TermColumns, near_one

DELAYS_S = (0.004, 0.008, 0.015, 0.025, 0.04, 0.06, 0.09, 0.14, 0.22, 0.35, 0.5)


def _column(load: LoadEstimate, setting: Setting) -> TermColumns:
    """Return one column: load minus load `delay_s` earlier; if not known, reading `delay_s` later minus reading."""
    seen, wrench, shift_s = load.observation, load.by_triangle, -setting["delay_s"]
    if not seen.load_is_known:
        wrench, shift_s = seen.by_triangle, setting["delay_s"]
    position = np.clip((seen.t_s + shift_s - seen.t_s[0]) / seen.step_s, 1, len(seen.t_s) - 2.001)

    def change(courses: Array) -> Array:
        return cubic_at(courses, position) - courses

    column = change(wrench)[..., None]
    if seen.load_is_known:
        return TermColumns((setting,), by_triangle=-column)
    return TermColumns((setting,), by_triangle=column, echo=noise_echo(seen, change))


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return a column for each delay of a board; a delay of the whole insole is a timing (`model.timing`)."""
    return [_column(load, {"delay_s": delay_s}) for delay_s in DELAYS_S]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return the delay, s."""
    return {"delay_s": float(settings[0]["delay_s"] * shares[0])}


TERM = Term(
    word="delay",
    scopes=("board",),
    share="positive",
    columns=_columns,
    parameters=_parameters,
    plausible=1.0,
    limit=2.0,
    refine=("delay_s",),
    column=_column,
    is_possible=near_one("delay_s", DELAYS_S[0]),
)
