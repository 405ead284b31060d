"""Rate-independent hysteresis after Prandtl and Ishlinskii: a weighted sum of play operators.

    play_r[P]: y_n = max(P_n − r, min(P_n + r, y_(n−1))), y = 0 before the first load

A play depends on the turning points of its input alone, and a load that is linear between its samples turns at
samples only: so it is exact. The inverse is again such a sum, with

    r'_j = w_0·r_j + Σ_(i<j) w_i·(r_j − r_i),   w'_0 = 1/w_0,   w'_j = 1/(w_0 + … + w_j) − 1/(w_0 + … + w_(j−1))

A count of noise is several kPa and drags small plays about. So live, what there is to correct is worked out from the
mean over NEAR taxels, which costs no time, and plays remember a course that is smoothed over REMEMBERED_S as well: a
reading is held against what has turned before it, and as soon as the load moves on it is followed without delay.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...skin.geometry import N_TAXELS, PRESSURE_TAXELS
from ..law import MOST_SHARED, Array, Law, Moments, Operator, Parameter, Site, Values, wrong_sum
from ..relaxation import Relaxation

NEAR = 7  # a taxel and the six around it
REMEMBERED_S = 0.025


class _Plays:
    """at_once · P + Σ w_j · play_rj[P]; `at_once` (m) or (1), `r` and `w` (k, 1) or (k, m)."""

    def __init__(self, at_once: Array, r: Array, w: Array) -> None:
        self._at_once, self._r, self._w = at_once, r, w
        self._y: Array | None = None

    def __call__(self, x: Array, moments: Moments) -> Array:
        return self.held_against(x, x)

    def held_against(self, remembered: Array, x: Array) -> Array:
        """Of `x` (n, m), where the plays have followed the course `remembered` (n, m) until the sample before."""
        last = np.zeros((len(self._r), x.shape[1])) if self._y is None else self._y
        y = np.empty((len(x), *last.shape))
        for followed, now, found in zip(remembered, x, y, strict=True):
            found[:] = self._moved(last, now)
            last = found if remembered is x else self._moved(last, followed)
        self._y = last.copy()
        y *= self._w
        q: Array = y.sum(axis=1)
        q += self._at_once * x
        return q

    def _moved(self, last: Array, x: Array) -> Array:
        moved: Array = np.minimum(last, x + self._r)
        np.maximum(moved, x - self._r, out=moved)
        return moved


def _forward(values: Values, site: Site) -> Operator:
    return _Plays(1.0 - values["w"].sum(axis=0), values["r_pa"], values["w"])


def _inverse(values: Values, site: Site) -> _Plays:
    r, w = np.broadcast_arrays(values["r_pa"], values["w"])
    order = np.argsort(r, axis=0)
    r, w = np.take_along_axis(r, order, axis=0), np.take_along_axis(w, order, axis=0)
    at_once = 1.0 - w.sum(axis=0)
    slope = at_once + np.concatenate([np.zeros_like(w[:1]), np.cumsum(w, axis=0)])  # of the first loading, by piece
    widths = np.diff(r, axis=0, prepend=0.0)
    return _Plays(1.0 / at_once, np.cumsum(slope[:-1] * widths, axis=0), np.diff(1.0 / slope, axis=0))


def _live(values: Values, site: Site) -> Operator:
    smooth = Relaxation(np.zeros(1), np.ones((1, 1)), np.full((1, 1), REMEMBERED_S))
    inverse = _inverse(values, site)
    near = _nearest(site)

    def live(x: Array, moments: Moments) -> Array:
        beside: Array = x[:, near].mean(axis=2)
        return x + inverse.held_against(smooth(beside, moments), beside) - beside

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
