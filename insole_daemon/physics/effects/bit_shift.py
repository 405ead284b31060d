"""A digitiser whose shift is not the one it is believed to have: counts of another size, floored and clamped.

Before it, a count is what is read on average (a floor reads (1 − 2^−shift)/2 more than there is), and need not be
whole; behind it, what the firmware sends. The arithmetic is the firmware's, in digitiser.py.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...errors import EffectError
from ..digitiser import clamped, codes_of, count_of
from ..law import Array, Law, Moments, Operator, Parameter, Site, Values


def _settings(values: Values, site: Site) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """(real shift, believed shift, no-load), each (m,) or (1,) int64."""
    if not len(site.shift):
        raise EffectError("the effect bit_shift needs the boards' settings: give the chain the boards (shift, no_load)")
    return values["shift"].astype(np.int64), site.shift, site.no_load


def _forward(values: Values, site: Site) -> Operator:
    real, believed, no_load = _settings(values, site)

    def forward(x: Array, moments: Moments) -> Array:
        codes = np.rint(codes_of(x, no_load, believed)).astype(np.int64)
        return clamped(codes, no_load, real).astype(np.float64)

    return forward


def _inverse(values: Values, site: Site) -> Operator:
    real, believed, no_load = _settings(values, site)

    def inverse(x: Array, moments: Moments) -> Array:
        return count_of(codes_of(x, no_load, real), no_load, believed)

    return inverse


LAW = Law(
    word="bit_shift",
    order=9,
    domain="count",
    equation="c = clamp(no_load − (value >> shift), 0, 255), value = (no_load − c_believed)·2^believed",
    source="icub-firmware, theSkin.cpp 439–461 and main_V3.c 905–978",
    parameters=(Parameter("shift", "1", 0, 7, (0, 7), "the real one", whole=True),),
    forward=_forward,
    inverse=_inverse,
    inverse_is="to half a step, 2^(shift − believed)/2 counts: the floor's bits are gone; clamped counts stay clamped",
)
