"""Rate-independent hysteresis after Prandtl and Ishlinskii: a weighted sum of play operators.

With `half_pa` the loop of a play closes as the load vanishes (`physics/closing_plays.py`).

    play_r[P]: y_n = max(P_n − r, min(P_n + r, y_(n−1))), y = 0 before the first load

A play depends only on the turning points of its input, and a load that is linear between its samples turns only at
samples, so it is exact. The inverse is a sum of the same form, with

    r'_j = w_0·r_j + Σ_(i<j) w_i·(r_j − r_i),   w'_0 = 1/w_0,   w'_j = 1/(w_0 + … + w_j) − 1/(w_0 + … + w_(j−1))

The noise of one count is several kPa and would move small plays. The live inverse therefore computes the correction
from the mean over NEAR taxels, which adds no delay, and its plays follow a signal that is also smoothed over
REMEMBERED_S: a reading is compared with earlier turning points, and a changing load is followed without delay.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...skin.geometry import N_TAXELS, PRESSURE_TAXELS
from ..closing_plays import ClosingPlays
from ..kernel_stage import KernelStage, StageKind
from ..law import MOST_SHARED, Array, Law, Moments, Operator, Parameter, Site, Values, sum_problem
from ..relaxation import Relaxation

NEAR = 7  # a taxel and the six around it
REMEMBERED_S = 0.025


class _Plays:
    """Computes at_once · P + Σ w_j · play_rj[P]; `at_once` (m) or (1), `r` and `w` (k, 1) or (k, m)."""

    def __init__(self, at_once: Array, r: Array, w: Array) -> None:
        self.at_once, self.r, self.w = at_once, r, w
        self._y: Array | None = None

    def __call__(self, x: Array, moments: Moments) -> Array:
        return self.apply_after(x, x)

    def apply_after(self, remembered: Array, x: Array) -> Array:
        """Return the output for `x` (n, m), with plays that follow `remembered` (n, m) up to the previous sample."""
        previous = np.zeros((len(self.r), x.shape[1])) if self._y is None else self._y
        y = np.empty((len(x), *previous.shape))
        for remembered_row, x_row, row in zip(remembered, x, y, strict=True):
            row[:] = self._step_plays(previous, x_row)
            previous = row if remembered is x else self._step_plays(previous, remembered_row)
        self._y = previous.copy()
        y *= self.w
        q: Array = y.sum(axis=1)
        q += self.at_once * x
        return q

    def _step_plays(self, last: Array, x: Array) -> Array:
        moved: Array = np.minimum(last, x + self.r)
        np.maximum(moved, x - self.r, out=moved)
        return moved


def _closes(values: Values) -> bool:
    return "half_pa" in values and bool(values["half_pa"].any())


def _forward(values: Values, site: Site) -> Operator:
    if _closes(values):
        return ClosingPlays(values["r_pa"], values["w"], values["half_pa"])
    return _Plays(1.0 - values["w"].sum(axis=0), values["r_pa"], values["w"])


def _inverse(values: Values, site: Site) -> _Plays | ClosingPlays:
    """Return the exact inverse; if no play closes, a sum of plays by the module's formula."""
    if _closes(values):
        return ClosingPlays(values["r_pa"], values["w"], values["half_pa"], is_inverse=True)
    r, w = np.broadcast_arrays(values["r_pa"], values["w"])
    order = np.argsort(r, axis=0)
    r, w = np.take_along_axis(r, order, axis=0), np.take_along_axis(w, order, axis=0)
    at_once = 1.0 - w.sum(axis=0)
    # Slope of the initial loading curve, by segment.
    slope = at_once + np.concatenate([np.zeros_like(w[:1]), np.cumsum(w, axis=0)])
    widths = np.diff(r, axis=0, prepend=0.0)
    return _Plays(1.0 / at_once, np.cumsum(slope[:-1] * widths, axis=0), np.diff(1.0 / slope, axis=0))


class _Live:
    """The inverse with less noise; see the module."""

    def __init__(self, inverse: _Plays | ClosingPlays, site: Site) -> None:
        self._smooth = Relaxation(np.zeros(1), np.ones((1, 1)), np.full((1, 1), REMEMBERED_S))
        self._inverse = inverse
        self._nearest = _nearest(site)

    def __call__(self, x: Array, moments: Moments) -> Array:
        local_mean: Array = x[:, self._nearest].mean(axis=2)
        undone = self._inverse.apply_after(self._smooth(local_mean, moments), local_mean)
        return x + undone - local_mean


class _LivePlays(_Live):
    """The same for plays that do not close, which the compiled kernel has, too."""

    _inverse: _Plays

    def kernel_stage(self, columns: NDArray[np.intp]) -> KernelStage:
        """Return it as a stage on the slots `columns` (m,)."""
        plays = self._inverse
        k, m = len(plays.r), len(columns)
        return KernelStage(
            StageKind.HYSTERESIS, k, columns, self._nearest, plays.at_once, plays.r, plays.w, (k + 2) * m + 1
        )


def _live(values: Values, site: Site) -> Operator:
    inverse = _inverse(values, site)
    return _LivePlays(inverse, site) if isinstance(inverse, _Plays) else _Live(inverse, site)


def _nearest(site: Site) -> NDArray[np.intp]:
    """Return (m, NEAR) the nearest pressure taxels of every column, itself included; fewer if there are few."""
    position_m = site.xy_m.reshape(-1, 2)[site.columns]
    distance_m = np.linalg.norm(position_m[:, None] - position_m, axis=2)
    distance_m[:, ~PRESSURE_TAXELS[site.columns % N_TAXELS]] = np.inf
    nearest: NDArray[np.intp] = np.argsort(distance_m, axis=1, kind="stable")[:, :NEAR]
    return nearest


LAW = Law(
    word="hysteresis",
    order=4,
    domain="pressure",
    equation="q = P − Σ w_j·(P − play_rj[P]), or Σ w_j·P/(P + h_j)·(P − play_rj[P]) with a half load h_j",
    source="Prandtl–Ishlinskii model and its exact inverse: Kuhnen, Eur. J. Control 9 (2003) 407–418; friction in "
    "proportion to the normal load after Amontons and Coulomb",
    parameters=(
        Parameter("r_pa", "Pa", 0.0, 1e7, (500.0, 50_000.0), "half the width of each play", "list"),
        Parameter("w", "1", 0.0, MOST_SHARED, (0.01, 0.12), "weight of each play", "list"),
        Parameter(
            "half_pa",
            "Pa",
            0.0,
            1e9,
            (5e3, 100e3),
            "loads at which those plays have half of their weight; 0 or absent: always the whole",
            "list",
            is_optional=True,
        ),
    ),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact",
    live=_live,
    find_problem=lambda values: sum_problem("w", values),
)
