"""Mean curve of a memory or snap, which a calibration made while it acted contains. A companion of both on walks.

The columns are the load in parts of its range: relative deviations of the static curves, linear between knots. Under a
known load the curves of each triangle are loose instead (`model.nuisance.Priors.curve_count`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from .stiffening import SCALE_PA
from .term import Setting, Term, TermColumns

KNOTS = 6  # from no load to the usual largest one


def knots_pa(load: LoadEstimate) -> Array:
    """Return the knots (KNOTS,), Pa; the deviation is constant beyond the last."""
    return np.linspace(0.0, load.top_pa, KNOTS)


def change_pa(pressure_pa: Array, at_pa: Array, shares: Array) -> Array:
    """Return the change of pressures (...) of the curves handed in, for `shares` (k,) at the knots `at_pa` (k,)."""
    return np.asarray(-pressure_pa * np.interp(pressure_pa, at_pa, shares))


def change_by_all_pa(pressure_pa: Array, at_pa: Array, shares: Mapping[str, Array]) -> Array:
    """Return the change of pressures (...) by all static companions of a memory, with their shares by word.

    That of a gain is exact for straight curves.
    """
    change = -pressure_pa * shares["gain"].sum() + pressure_pa**2 / SCALE_PA * shares["stiffening"].sum()
    own = shares["mean_curve"]
    return np.asarray(change + change_pa(pressure_pa, at_pa, own) if len(own) else change)


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return joint columns: the change by each knot's share."""
    at_pa = knots_pa(load)
    columns = [load.wrench_of(change_pa(load.pressure_pa, at_pa, hat)) for hat in np.eye(KNOTS)]
    settings = tuple({"knot_pa": knot} for knot in at_pa.tolist())
    return [TermColumns(settings, by_triangle=np.stack(columns, axis=-1), joint=True)]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return no parameters: the term is never reported."""
    return {}


def _needs(load: LoadEstimate) -> str | None:
    return "the curves of each triangle are loose under a known load" if load.is_known else None


TERM = Term(
    word="mean_curve",
    scopes=("insole", "board"),  # the wrench does not tell the curve of a triangle
    share="free",
    columns=_columns,
    parameters=_parameters,
    needs=_needs,
    is_internal=True,
)
