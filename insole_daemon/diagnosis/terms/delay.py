"""`delay`: readings come late. c(t) ← c(t − d)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from .term import Setting, Term, TermColumns

DELAYS_S = (0.004, 0.008, 0.015, 0.025, 0.04, 0.06, 0.09, 0.14, 0.22, 0.35, 0.5)


def _column(load: LoadEstimate, setting: Setting) -> TermColumns:
    """One column: the load less what it was `delay_s` before; where it is not known, readings then less those now."""
    seen, own, shift_s = load.observation, load.by_triangle, -setting["delay_s"]
    if not seen.load_is_known:
        own, shift_s = seen.by_triangle, setting["delay_s"]
    position = np.clip((seen.t_s + shift_s - seen.t_s[0]) / seen.step_s, 1, len(seen.t_s) - 2.001)
    column = (cubic_at(own, position) - own)[..., None]
    if seen.load_is_known:
        return TermColumns((setting,), by_triangle=-column)
    # The noise of a reading stands in the residual with −1; here with what the cubic takes of it, less 1.
    shift = setting["delay_s"] / seen.step_s
    taken = cubic_at(np.eye(9)[4], np.array([4.0 - shift if shift < 4 else 0.5]))[0] if shift < 4 else 0.0
    others = _square_of_cubic(shift % 1.0) - (taken**2 if shift < 2 else 0.0)
    variance = seen.counting_variance[..., None]
    echo = (variance * (1.0 - taken), variance * ((1.0 - taken) ** 2 + others))
    return TermColumns((setting,), by_triangle=column, echo=echo)


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """A column for each delay of a board; that of the whole insole is a timing of the reference."""
    return [_column(load, {"delay_s": delay_s}) for delay_s in DELAYS_S]


def cubic_at(values: Array, position: Array) -> Array:
    """(n, ...) rows of `values` at fractional `position` (n,), by a Catmull–Rom cubic."""
    left = position.astype(np.intp)
    x = (position - left).reshape(-1, *(1,) * (values.ndim - 1))
    p0, p1, p2, p3 = (
        (values[left + step] for step in (-1, 0, 1, 2))
        if left.max() + 2 < len(values)
        else (values[np.clip(left + step, 0, len(values) - 1)] for step in (-1, 0, 1, 2))
    )
    found = p1 + 0.5 * x * (p2 - p0 + x * (2 * p0 - 5 * p1 + 4 * p2 - p3 + x * (3 * (p1 - p2) + p3 - p0)))
    return np.asarray(found)


def _square_of_cubic(share: float) -> float:
    weights = cubic_at(np.eye(4), np.array([1.0 + share]))[0]
    return float(np.sum(weights**2))


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """The delay in s."""
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
