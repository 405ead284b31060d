"""`drift`: counts shift slowly with time. P ≈ q + g′(a)·shift(t), with g the static curve and a the activation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from .term import Setting, Term, TermColumns

KNOTS = 6  # of the shift over time, beside the first, at which it is 0
KNOWN_KNOTS = 12  # if the load is known
LEAST_S = 20.0  # shortest recording in which a drift is looked for


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return joint columns: the wrench of g′(a), times hat functions over time."""
    seen = load.observation
    if float(np.ptp(seen.t_s)) < LEAST_S:
        return []
    knots = KNOWN_KNOTS if load.is_known else KNOTS
    knots_s = np.linspace(seen.t_s[0], seen.t_s[-1], knots + 1)
    hats = np.stack([np.interp(seen.t_s, knots_s, hat) for hat in np.eye(knots + 1)[1:]], axis=-1)
    columns = load.wrench_of(load.slope_pa)[..., None] * hats[:, None, None]
    return [TermColumns(tuple({"t_s": float(t)} for t in knots_s[1:]), by_triangle=columns, joint=True)]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return times, s, and shifts, counts."""
    return {
        "t_s": [0.0, *(float(setting["t_s"]) for setting in settings)],
        "shift_count": [0.0, *(float(share) for share in shares)],
    }


TERM = Term(
    word="drift",
    scopes=("insole", "board", "triangle"),
    share="free",
    columns=_columns,
    parameters=_parameters,
    plausible=0.3,
    limit=40,
    misfit=0.015,
    yields_to=("temperature",),
)
