"""Compensation: the firmware's temperature compensation, in whole codes, from pad 6 alone.

    drift_k = ((|dT| >> 2) · gain_k) >> 5, with the sign of dT;   value ← value − drift_k

dT is the change of pad 6 in codes since the baseline was taken, here `count_per_k` times the temperature change at that
pad. The sensors' own temperature response is the effect `temperature`; both together give the remaining error. A board
of the simulator compensates the temperature of its own pads by itself; there the effect adds to it.
"""

from __future__ import annotations

import numpy as np

from ...errors import EffectError
from ...skin.geometry import N_TAXELS, THERMAL_PADS
from ..digitiser import GAINS_TYPE_0, GAINS_TYPE_8, compensation_codes
from ..law import Array, Law, Moments, Operator, Parameter, Site, Values

_GAINS = {0: GAINS_TYPE_0, 8: GAINS_TYPE_8}
_MTB3 = 3


class _Compensation:
    """Computes what the compensation subtracts from the activations of whole triangles."""

    def __init__(self, values: Values, site: Site) -> None:
        if not len(site.shift):
            raise EffectError("the effect compensation needs the boards' settings: give the chain the boards (shift)")
        self._gains = _GAINS[int(values["skin_type"][0])]
        self._is_16_bit = bool(values["generation"][0] == _MTB3)
        self._pads = site.columns[THERMAL_PADS[0] :: N_TAXELS]
        self._step = np.ldexp(1.0, site.shift[::N_TAXELS])
        self._codes_per_k, self._t0_c = values["count_per_k"] * self._step, values["t0_c"]

    def __call__(self, moments: Moments) -> Array:
        """Return (n, m) counts; EffectError without temperatures."""
        temperature_c = moments.temperature_c
        if temperature_c is None:
            raise EffectError(
                "the effect compensation needs temperature_c, (n,) or (n, n_triangles, 12), with the samples"
            )
        at_pads = temperature_c if temperature_c.shape[1] == 1 else temperature_c[:, self._pads]
        codes_of_pad = np.zeros((len(temperature_c), len(self._pads), N_TAXELS), np.int64)
        codes_of_pad[..., THERMAL_PADS[0]] = np.rint(self._codes_per_k * (at_pads - self._t0_c))
        compensation = compensation_codes(codes_of_pad, np.zeros_like(codes_of_pad), self._gains, self._is_16_bit)
        counts: Array = (compensation / self._step[:, None]).reshape(len(temperature_c), -1)
        return counts


def _signed_operator(sign: float, values: Values, site: Site) -> Operator:
    compensation = _Compensation(values, site)

    def operator(x: Array, moments: Moments) -> Array:
        y = x.copy()
        y[:, site.columns] += sign * compensation(moments)
        return y

    return operator


def _find_problem(values: Values) -> tuple[str, str] | None:
    skin_type = int(values["skin_type"][0])
    if skin_type in _GAINS:
        return None
    return "skin_type", f"expected 0 or 8, the types with a compensation, found {skin_type}"


LAW = Law(
    word="compensation",
    order=8,
    domain="activation",
    equation="value ← value − sign(dT)·(((|dT| >> 2)·gain_k) >> 5), dT codes of pad 6; baseline − c = value/2^shift",
    source="icub-firmware, theSkin.cpp 325–395 (MTB4: rounds down), main_V3.c 901–963 (MTB3: 16 bits, towards zero)",
    parameters=(
        Parameter("skin_type", "1", 0, 8, (0, 8), "skin type whose gains apply: 0 or 8", whole=True),
        Parameter("generation", "1", 3, 4, (3, 4), "generation of the board: MTB3 or MTB4", whole=True),
        Parameter("count_per_k", "count/K", -50.0, 50.0, (-3.0, 3.0), "change of pad 6's activation per kelvin"),
        Parameter("t0_c", "°C", -40.0, 85.0, (15.0, 35.0), "T0: temperature of the baseline"),
    ),
    forward=lambda values, site: _signed_operator(-1.0, values, site),
    inverse=lambda values, site: _signed_operator(1.0, values, site),
    inverse_is="exact, given the temperature",
    needs_temperature=True,
    scopes=("insole", "board"),
    sees_all=True,
    find_problem=_find_problem,
)
