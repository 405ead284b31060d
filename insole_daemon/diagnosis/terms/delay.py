"""`delay`: readings are late by a constant time d. c(t) ← c(t − d)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from .term import Setting, Term, TermColumns

DELAYS_S = (0.004, 0.008, 0.015, 0.025, 0.04, 0.06, 0.09, 0.14, 0.22, 0.35, 0.5)


def _column(load: LoadEstimate, setting: Setting) -> TermColumns:
    """Return one column: load minus load `delay_s` earlier; if not known, reading `delay_s` later minus reading."""
    seen, wrench, shift_s = load.observation, load.by_triangle, -setting["delay_s"]
    if not seen.load_is_known:
        wrench, shift_s = seen.by_triangle, setting["delay_s"]
    position = np.clip((seen.t_s + shift_s - seen.t_s[0]) / seen.step_s, 1, len(seen.t_s) - 2.001)
    column = (cubic_at(wrench, position) - wrench)[..., None]
    if seen.load_is_known:
        return TermColumns((setting,), by_triangle=-column)
    # The noise of a row enters the residual with weight −1, and the column with its weight in the cubic, minus 1.
    shift = setting["delay_s"] / seen.step_s
    weight = cubic_at(np.eye(9)[4], np.array([4.0 - shift if shift < 4 else 0.5]))[0] if shift < 4 else 0.0
    others = _square_of_cubic(shift % 1.0) - (weight**2 if shift < 2 else 0.0)
    variance = seen.counting_variance[..., None]
    echo = (variance * (1.0 - weight), variance * ((1.0 - weight) ** 2 + others))
    return TermColumns((setting,), by_triangle=column, echo=echo)


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return a column for each delay of a board; a delay of the whole insole is a timing (`model.timing`)."""
    return [_column(load, {"delay_s": delay_s}) for delay_s in DELAYS_S]


def cubic_at(values: Array, position: Array) -> Array:
    """Return rows (n, ...) of `values` (N, ...) at fractional row numbers `position` (n,), by a Catmull–Rom cubic.

    Source: E. Catmull and R. Rom, A class of local interpolating splines, 1974.
    """
    row = position.astype(np.intp)
    x = (position - row).reshape(-1, *(1,) * (values.ndim - 1))
    p0, p1, p2, p3 = (
        (values[row + step] for step in (-1, 0, 1, 2))
        if row.max() + 2 < len(values)
        else (values[np.clip(row + step, 0, len(values) - 1)] for step in (-1, 0, 1, 2))
    )
    interpolated = p1 + 0.5 * x * (p2 - p0 + x * (2 * p0 - 5 * p1 + 4 * p2 - p3 + x * (3 * (p1 - p2) + p3 - p0)))
    return np.asarray(interpolated)


def _square_of_cubic(fraction: float) -> float:
    """Return the sum of squares of the cubic's four weights at a `fraction` of the step between two rows."""
    weights = cubic_at(np.eye(4), np.array([1.0 + fraction]))[0]
    return float(np.sum(weights**2))


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
)
