"""`stiffening`: readings grow less than the load beyond a knee. q = knee + x·span/(span + x), x = P − knee.

So P = q + (q − knee)²/(span − (q − knee)) beyond the knee.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from .term import Setting, Term, TermColumns, needs_calibration

SCALE_PA = 1e5
LEAST_LEFT = 0.2  # of the span: readings closer to its end hardly depend on the load
KNEES = (0.0, 0.3, 0.5, 0.65, 0.8)  # relative to the largest pressures


def _column(load: LoadEstimate, setting: Setting) -> TermColumns:
    """Return one column for a knee: the wrench of (q − knee)²/(100 kPa − share·(q − knee)) beyond it.

    If the load is known, of x − x·span/(span + x) = x²/(span + x) with x = P − knee, times span/100 kPa.
    """
    over = np.maximum(load.pressure_pa - setting["knee_pa"], 0.0) / SCALE_PA
    share = setting.get("share", 0.0)
    span_left = 1.0 + over * share if load.is_known else np.maximum(1.0 - over * share, LEAST_LEFT)
    return TermColumns((setting,), by_triangle=load.wrench_of(SCALE_PA * over**2 / span_left)[..., None])


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return a column for each knee."""
    highest = float(np.quantile(load.pressure_pa.max(axis=0)[load.observation.usable], 0.95))
    return [_column(load, {"knee_pa": share * highest}) for share in KNEES]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return knee and span, Pa."""
    return {"knee_pa": float(settings[0]["knee_pa"]), "span_pa": SCALE_PA / max(float(shares[0]), 1e-4)}


TERM = Term(
    word="stiffening",
    scopes=("insole", "board", "triangle"),
    share="positive",
    columns=_columns,
    parameters=_parameters,
    plausible=0.3,
    limit=3.0,
    misfit=0.02,
    refine=("knee_pa",),
    linear_at="share",
    column=_column,
    needs=needs_calibration,
)
