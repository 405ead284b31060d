"""Bit shift: a digitiser whose shift differs from the configured one, so counts have another size.

The input of the effect is a mean count (the floor adds (1 − 2^−shift)/2), which need not be whole; its output is what
the firmware sends. The arithmetic is that of the firmware, in digitiser.py.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...errors import EffectError
from ..digitiser import clamp_counts, codes_of, count_of
from ..law import Array, Law, Moments, Operator, Parameter, Site, Values


def _settings(values: Values, site: Site) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return real shift, believed shift and no-load, each (m,) or (1,) int64; EffectError without boards' settings."""
    if not len(site.shift):
        raise EffectError("the effect bit_shift needs the boards' settings: give the chain the boards (shift, no_load)")
    return values["shift"].astype(np.int64), site.shift, site.no_load


def _forward(values: Values, site: Site) -> Operator:
    real, believed, no_load = _settings(values, site)

    def forward(x: Array, moments: Moments) -> Array:
        codes = np.rint(codes_of(x, no_load, believed)).astype(np.int64)
        return clamp_counts(codes, no_load, real).astype(np.float64)

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
    parameters=(Parameter("shift", "1", 0, 7, (0, 7), "the real shift", whole=True),),
    forward=_forward,
    inverse=_inverse,
    inverse_is="to half a step, 2^(shift − believed)/2 counts: the floor's bits are gone; clamped counts stay clamped",
)
