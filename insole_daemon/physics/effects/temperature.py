"""Temperature: the change of offset and gain that the firmware's compensation leaves.

The firmware subtracts dT · gain_k / 128 with dT the change of pad 6 (digitiser.py, `compensation_codes`). The remainder
is linear in the temperature as long as both are, and has either sign: a taxel may be overcompensated.
"""

from __future__ import annotations

import numpy as np

from ...errors import EffectError
from ..law import Array, Law, Moments, Operator, Parameter, Site, Values

_MIN_GAIN = 0.05  # the linear law does not hold so far from T0


def _gain_and_shift(values: Values, moments: Moments) -> tuple[Array, Array]:
    """Return (n, m) or (n, 1) the gain, and the shift of the activation; EffectError without temperatures."""
    if moments.temperature_c is None:
        raise EffectError("the effect temperature needs temperature_c, (n,) or (n, n_triangles, 12), with the samples")
    above_t0_k = moments.temperature_c - values["t0_c"]
    return np.maximum(1.0 + values["gain_per_k"] * above_t0_k, _MIN_GAIN), values["count_per_k"] * above_t0_k


def _forward(values: Values, site: Site) -> Operator:
    def forward(x: Array, moments: Moments) -> Array:
        gain, shift = _gain_and_shift(values, moments)
        return x * gain - shift

    return forward


def _inverse(values: Values, site: Site) -> Operator:
    def inverse(x: Array, moments: Moments) -> Array:
        gain, shift = _gain_and_shift(values, moments)
        return (x + shift) / gain

    return inverse


LAW = Law(
    word="temperature",
    order=8,
    domain="activation",
    equation="baseline − c ← (1 + γ·(T − T0))·(baseline − c) − β·(T − T0)",
    source="linear in T as the firmware's compensation is: icub-firmware, theSkin.cpp 325–395; 0 to 10 % over 8 K",
    parameters=(
        Parameter("count_per_k", "count/K", -50.0, 50.0, (-1.0, 1.0), "β: change of the count per kelvin"),
        Parameter("gain_per_k", "1/K", -0.1, 0.1, (-0.0125, 0.0125), "γ: change of the gain per kelvin"),
        Parameter("t0_c", "°C", -40.0, 85.0, (15.0, 35.0), "T0: temperature of the calibration"),
    ),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact, given the temperature",
    needs_temperature=True,
)
