"""Rate-independent hysteresis after Prandtl and Ishlinskii: a weighted sum of play operators.

    play_r[P]: y_n = max(P_n − r, min(P_n + r, y_(n−1))), y = 0 before the first load

A play depends on the turning points of its input alone, and a load that is linear between its samples turns at
samples only: so it is exact. The inverse is again such a sum, with

    r'_j = w_0·r_j + Σ_(i<j) w_i·(r_j − r_i),   w'_0 = 1/w_0,   w'_j = 1/(w_0 + … + w_j) − 1/(w_0 + … + w_(j−1))

A count of noise is several kPa and drags small plays about. So live, what there is to correct is worked out from
smoother readings and added to the reading as it is: nothing arrives later for it. They are smoothed over NEAR taxels,
which costs no time, and over SMOOTHED_S: more would know too late that a load turns.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...skin.geometry import N_TAXELS, PRESSURE_TAXELS
from ..law import MOST_SHARED, Array, Law, Moments, Operator, Parameter, Site, Values, wrong_sum
from ..relaxation import Relaxation

NEAR = 7  # a taxel and the six around it
SMOOTHED_S = 0.02


class _Plays:
    """at_once · P + Σ w_j · play_rj[P]; `at_once` (m) or (1), `r` and `w` (k, 1) or (k, m)."""

    def __init__(self, at_once: Array, r: Array, w: Array) -> None:
        self._at_once, self._r, self._w = at_once, r, w
        self._y: Array | None = None

    def __call__(self, x: Array, moments: Moments) -> Array:
        if self._y is None:
            self._y = np.zeros((len(self._r), x.shape[1]))
        high = x[:, None] + self._r
        y = x[:, None] - self._r
        last = self._y
        for ceiling, row in zip(high, y, strict=True):
            np.minimum(last, ceiling, out=ceiling)
            last = np.maximum(ceiling, row, out=row)
        self._y = last.copy()
        y *= self._w
        q: Array = y.sum(axis=1)
        q += self._at_once * x
        return q


def _forward(values: Values, site: Site) -> Operator:
    return _Plays(1.0 - values["w"].sum(axis=0), values["r_pa"], values["w"])


def _inverse(values: Values, site: Site) -> Operator:
    r, w = np.broadcast_arrays(values["r_pa"], values["w"])
    order = np.argsort(r, axis=0)
    r, w = np.take_along_axis(r, order, axis=0), np.take_along_axis(w, order, axis=0)
    at_once = 1.0 - w.sum(axis=0)
    slope = at_once + np.concatenate([np.zeros_like(w[:1]), np.cumsum(w, axis=0)])  # of the first loading, by piece
    widths = np.diff(r, axis=0, prepend=0.0)
    return _Plays(1.0 / at_once, np.cumsum(slope[:-1] * widths, axis=0), np.diff(1.0 / slope, axis=0))


def _live(values: Values, site: Site) -> Operator:
    smooth = Relaxation(np.zeros(1), np.ones((1, 1)), np.full((1, 1), SMOOTHED_S))
    inverse = _inverse(values, site)
    near = _nearest(site)

    def live(x: Array, moments: Moments) -> Array:
        smoothed = smooth(x[:, near].mean(axis=2), moments)
        return x + (inverse(smoothed, moments) - smoothed)

    return live


def _nearest(site: Site) -> NDArray[np.intp]:
    """(m, NEAR) of every column those of the nearest taxels that bear pressure, its own among them; fewer if few."""
    at_m = site.xy_m.reshape(-1, 2)[site.columns]
    apart_m = np.linalg.norm(at_m[:, None] - at_m, axis=2)
    apart_m[:, ~PRESSURE_TAXELS[site.columns % N_TAXELS]] = np.inf
    found: NDArray[np.intp] = np.argsort(apart_m, axis=1, kind="stable")[:, :NEAR]
    return found


LAW = Law(
    word="hysteresis",
    order=4,
    domain="pressure",
    equation="q = (1 − Σ w_j)·P + Σ w_j·play_rj[P]",
    source="Prandtl–Ishlinskii model and its exact inverse: Kuhnen, Eur. J. Control 9 (2003) 407–418",
    parameters=(
        Parameter("r_pa", "Pa", 0.0, 1e7, (500.0, 50_000.0), "half the width of each play", "list"),
        Parameter("w", "1", 0.0, MOST_SHARED, (0.01, 0.12), "weight of each play", "list"),
    ),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact",
    live=_live,
    wrong=lambda values: wrong_sum("w", values),
)
