"""Drift: the unloaded count changes slowly with time."""

from __future__ import annotations

import numpy as np

from ..law import Array, Law, Operator, Parameter, Site, Values
from ..portable import interpolate


def _shift(values: Values, t_s: Array) -> Array:
    """Return (n, m) or (n, 1) the shift of the count: linear between the knots, constant before and after them."""
    knots, shift = np.broadcast_arrays(values["t_s"], values["shift_count"])
    return np.stack([interpolate(t_s, knots[:, i], shift[:, i]) for i in range(knots.shape[1])], axis=1)


def _forward(values: Values, site: Site) -> Operator:
    return lambda x, moments: x - _shift(values, moments.t_s)


def _inverse(values: Values, site: Site) -> Operator:
    return lambda x, moments: x + _shift(values, moments.t_s)


def _find_problem(values: Values) -> tuple[str, str] | None:
    if (np.diff(values["t_s"], axis=0) > 0).all():
        return None
    return "t_s", "expected times that grow, each later than the one before"


LAW = Law(
    word="drift",
    order=8,
    domain="activation",
    equation="c ← c + shift(t), linear between the times given, constant before and after them",
    source="observed on capacitive insoles (Pedar: offsets drift over hours); a curve without a mechanism",
    parameters=(
        Parameter("t_s", "s", -1e9, 1e9, (0.0, 3600.0), "times at which the shift is given", "list"),
        Parameter("shift_count", "count", -255.0, 255.0, (-5.0, 5.0), "shift of the count at these times", "list"),
    ),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact",
    find_problem=_find_problem,
)
