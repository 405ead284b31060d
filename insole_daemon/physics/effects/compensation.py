"""The firmware's own temperature compensation, as it is: in whole codes, of pad 6 alone.

    drift_k = ((|dT| >> 2) · gain_k) >> 5, with the sign of dT;   value ← value − drift_k

dT is the change of pad 6 in codes since the baseline was taken: here what `count_per_k` makes of the temperature at
that pad. The sensors' own answer to warmth is the effect `temperature`; both together are what is left of it. A
board of the simulator compensates by itself what its own pads feel: there the effect is what pad 6 feels besides.
"""

from __future__ import annotations

import numpy as np

from ...errors import EffectError
from ...skin.geometry import N_TAXELS, THERMAL_PADS
from ..digitiser import GAINS_TYPE_0, GAINS_TYPE_8, drift
from ..law import Array, Law, Moments, Operator, Parameter, Site, Values

_GAINS = {0: GAINS_TYPE_0, 8: GAINS_TYPE_8}
_MTB3 = 3


class _Drift:
    """What the compensation takes off the activations of whole triangles."""

    def __init__(self, values: Values, site: Site) -> None:
        if not len(site.shift):
            raise EffectError("the effect compensation needs the boards' settings: give the chain the boards (shift)")
        self._gains = _GAINS[int(values["skin_type"][0])]
        self._narrow = bool(values["generation"][0] == _MTB3)
        self._pads = site.columns[THERMAL_PADS[0] :: N_TAXELS]
        self._step = np.ldexp(1.0, site.shift[::N_TAXELS])
        self._codes_per_k, self._t0_c = values["count_per_k"] * self._step, values["t0_c"]

    def __call__(self, moments: Moments) -> Array:
        """(n, m) counts."""
        warm = moments.temperature_c
        if warm is None:
            raise EffectError(
                "the effect compensation needs temperature_c, (n,) or (n, n_triangles, 12), with the samples"
            )
        at_pads = warm if warm.shape[1] == 1 else warm[:, self._pads]
        raw = np.zeros((len(warm), len(self._pads), N_TAXELS), np.int64)
        raw[..., THERMAL_PADS[0]] = np.rint(self._codes_per_k * (at_pads - self._t0_c))
        codes = drift(raw, np.zeros_like(raw), self._gains, self._narrow)
        counts: Array = (codes / self._step[:, None]).reshape(len(warm), -1)
        return counts


def _with_sign(sign: float, values: Values, site: Site) -> Operator:
    taken_off = _Drift(values, site)

    def operator(x: Array, moments: Moments) -> Array:
        y = x.copy()
        y[:, site.columns] += sign * taken_off(moments)
        return y

    return operator


def _wrong(values: Values) -> tuple[str, str] | None:
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
        Parameter("skin_type", "1", 0, 8, (0, 8), "whose gains: 0 or 8", whole=True),
        Parameter("generation", "1", 3, 4, (3, 4), "of the board: MTB3 or MTB4", whole=True),
        Parameter("count_per_k", "count/K", -50.0, 50.0, (-3.0, 3.0), "what a kelvin adds to pad 6, as an activation"),
        Parameter("t0_c", "°C", -40.0, 85.0, (15.0, 35.0), "T0: of the baseline"),
    ),
    forward=lambda values, site: _with_sign(-1.0, values, site),
    inverse=lambda values, site: _with_sign(1.0, values, site),
    inverse_is="exact, given the temperature",
    needs_temperature=True,
    scopes=("insole", "board"),
    sees_all=True,
    wrong=_wrong,
)
