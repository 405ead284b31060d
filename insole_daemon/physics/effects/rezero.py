"""Re-zero: a board takes new baselines, silently and under any load."""

from __future__ import annotations

import numpy as np

from ..law import Array, Law, Moments, Operator, Parameter, Site, Values


def _shift(values: Values, moments: Moments) -> Array:
    """Return (n, m) or (n, 1) the shift of the count."""
    return np.where(moments.t_s[:, None] >= values["t_s"], values["shift_count"], 0.0)


def _forward(values: Values, site: Site) -> Operator:
    return lambda x, moments: x - _shift(values, moments)


def _inverse(values: Values, site: Site) -> Operator:
    return lambda x, moments: x + _shift(values, moments)


LAW = Law(
    word="rezero",
    order=8,
    domain="activation",
    equation="c ← c + shift from t on",
    source="icub-firmware: after five read errors, or a configuration (theSkin.cpp 497–509, main_V3.c 1022–1038)",
    parameters=(
        Parameter("t_s", "s", -1e9, 1e9, (0.0, 3600.0), "time of the re-zero"),
        Parameter("shift_count", "count", -255.0, 255.0, (-60.0, 60.0), "shift of the count since then"),
    ),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact",
    scopes=("board",),
)
