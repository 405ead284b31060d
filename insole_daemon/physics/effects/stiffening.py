"""Stiffening: beyond the knee the dielectric yields less and less (bottoming out).

The knee is beyond the calibrated range: the load that the static curve indicates grows more slowly than the true load.
Air in a closed volume resists as p_h·s/(s_max − s), which has the same shape.
"""

from __future__ import annotations

import numpy as np

from ..law import Array, Law, Moments, Operator, Parameter, Site, Values

_END = 1 - 1e-6  # fraction of the span to which a reading is clipped


def _forward(values: Values, site: Site) -> Operator:
    knee, span = values["knee_pa"], values["span_pa"]

    def forward(x: Array, moments: Moments) -> Array:
        over = np.maximum(x - knee, 0.0)
        q: Array = np.minimum(x, knee) + over * span / (span + over)
        return q

    return forward


def _inverse(values: Values, site: Site) -> Operator:
    knee, span = values["knee_pa"], values["span_pa"]

    def inverse(x: Array, moments: Moments) -> Array:
        over = np.clip(x - knee, 0.0, _END * span)
        load: Array = np.minimum(x, knee) + over * span / (span - over)
        return load

    return inverse


LAW = Law(
    word="stiffening",
    order=7,
    domain="pressure",
    equation="q = P up to the knee; beyond, with x = P − knee: q = knee + x·span/(span + x)",
    source="bottoming P = p_h·s/(s_max − s) of a foam's last phase: Gibson & Ashby, Cellular Solids (1997), ch. 5",
    parameters=(
        Parameter("knee_pa", "Pa", 0.0, 1e7, (150_000.0, 600_000.0), "load above which it stiffens"),
        Parameter("span_pa", "Pa", 1_000.0, 1e9, (100_000.0, 2_000_000.0), "largest rise of q beyond the knee"),
    ),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact; a reading at or beyond the end of the span, which no load reaches, is clipped just before it",
)
