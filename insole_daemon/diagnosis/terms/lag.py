"""`lag`: a first-order low-pass between load and reading. τ·dq/dt = P − q, so P = q + τ·dq/dt."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..observations.interpolated_noise import noise_echo
from ..operators import low_pass
from .term import Setting, Term, TermColumns, near_one

LAGS_S = (0.02, 0.04, 0.08, 0.16, 0.32)  # under a known load


def _column(load: LoadEstimate, setting: Setting) -> TermColumns:
    """Return one column: the load minus its low pass; if it is not known, τ·dq/dt of the readings."""
    seen = load.observation
    if seen.load_is_known:
        own = load.by_triangle
        late = low_pass(own, seen.step_s, setting["tau_s"])
        return TermColumns((setting,), by_triangle=(own - late)[..., None])

    def change(courses: Array) -> Array:
        return np.asarray(setting["tau_s"] * np.gradient(courses, seen.step_s, axis=0))

    return TermColumns((setting,), by_triangle=change(seen.by_triangle)[..., None], echo=noise_echo(seen, change))


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return columns for boards, linear in τ if the load is not known.

    A lag of the whole insole is a timing (`model.timing`).
    """
    return [_column(load, {"tau_s": tau_s}) for tau_s in (LAGS_S if load.is_known else LAGS_S[:1])]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return the time constant, s."""
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
    is_possible=near_one("tau_s", LAGS_S[0]),
)
