"""`lag`: readings follow the load with a time constant. τ·dq/dt = P − q, so P = q + τ·dq/dt."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..operators import low_pass
from .term import Setting, Term, TermColumns


def _column(load: LoadEstimate, setting: Setting) -> TermColumns:
    """One column: the load less what follows it; where it is not known, τ·dq/dt of every triangle."""
    seen = load.observation
    if seen.load_is_known:
        own = load.by_triangle
        late = low_pass(own[..., 0], seen.step_s, setting["tau_s"])[..., None]
        return TermColumns((setting,), by_triangle=(own - late)[..., None])
    slope = np.gradient(seen.by_triangle, seen.step_s, axis=0)
    square = seen.counting_variance[..., None] * 0.5 * (setting["tau_s"] / seen.step_s) ** 2
    echo = (np.zeros_like(square), square)
    return TermColumns((setting,), by_triangle=(setting["tau_s"] * slope)[..., None], echo=echo)


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """A column of boards, which is linear in τ; the lag of the whole insole is a timing of the reference."""
    return [_column(load, {"tau_s": 0.02})]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """The time constant in s."""
    return {"tau_s": float(settings[0]["tau_s"] * shares[0])}


TERM = Term(
    word="lag",
    scopes=("board",),
    share="positive",
    columns=_columns,
    parameters=_parameters,
    plausible=1.0,
    limit=5.0,
    yields_to=("delay",),
    misfit=0.1,
    refine=("tau_s",),
    column=_column,
)
