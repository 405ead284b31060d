"""`drift`: counts that wander slowly. P ≈ q + g′(a)·shift(t)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from .term import Setting, Term, TermColumns

KNOTS = 6  # beside the first, at which the shift is 0
KNOWN_KNOTS = 12  # of a load that is known
LEAST_S = 20.0


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Joint columns: hats over time times g′(a)."""
    seen = load.observation
    if float(np.ptp(seen.t_s)) < LEAST_S:
        return []
    knots = KNOWN_KNOTS if load.is_known else KNOTS
    knots_s = np.linspace(seen.t_s[0], seen.t_s[-1], knots + 1)
    hats = np.stack([np.interp(seen.t_s, knots_s, hat) for hat in np.eye(knots + 1)[1:]], axis=-1)
    own = load.wrench_of(load.slope_pa)[..., None] * hats[:, None, None]
    return [TermColumns(tuple({"t_s": float(t)} for t in knots_s[1:]), by_triangle=own, joint=True)]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Times in s and shifts in counts."""
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
