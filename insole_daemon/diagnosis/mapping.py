"""Whether the taxels are where, and who, the map says they are: triangles that are swapped, a map that lies askew.

Everything else a diagnosis says of a load with places depends on it, so it is asked first:

    v_i(t) ≈ o_i + g_i · Σ_j A_ij(θ) · M[P_j](t + clock)

v: what the calibration makes of the readings, P: the simulated load, A: where taxel i is looked for in it. Offsets o
and gains g are each taxel's own, gains near the insole's; θ, the clock and the memory M, any mixture of low-passes, are
common nuisances: a heel that answers late is no heel that lies further back. The load between its taxels is
interpolated with a Gaussian process, whose length the load itself tells (Rasmussen & Williams 2006, section 2.2).

P is few courses in time, so all sums over time are made once: least squares on their Gram matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import solve_triangular

from ..physics.effects.crosstalk import neighbours
from ..physics.law import Array
from ..skin.geometry import N_TAXELS, PRESSURE_TAXELS
from ..skin.layout import Layout
from .field import Field
from .operators import low_pass

LENGTHS_M = np.geomspace(0.006, 0.05, 8)  # of the interpolation
NUGGETS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
KNOWN = 0.003  # of the load's variance: where no more is left open than at the simulation's own taxels, it is known
GAIN_SPREAD = 0.15  # of calibrations, from taxel to taxel
TAUS_S = (0.03, 0.12, 0.5, 3.0)  # of the memory
NUDGE = np.array([0.1, 0.1, 0.05, 1e-3, 1e-3, 1e-3, 1e-5, *(1e-3,) * len(TAUS_S)])
# θ: x_mm, y_mm, rotation_deg and the logarithm of scale; k of crosstalk; offset_s and rate of the clock; the memory.
PLACE, SPREAD, TIME = slice(0, 4), slice(4, 5), slice(5, 7 + len(TAUS_S))
NOWHERE = np.zeros(len(NUDGE))
MOST_SPREAD = 0.45
MOST_STEPS = 25
_PRIOR = 1.0 / GAIN_SPREAD**2
_RIDGE, _SETTLED = 1e-9, 1e-7
_CENTRE = 3  # the taxel in the middle of a triangle


class Interpolation:
    """The load between the taxels that a simulation knows: of each shape the mean of all fields that go with it.

    Its length and what of it is noise maximise the marginal likelihood (Rasmussen & Williams, section 5.4). Because it
    is that mean, what it is off by is not correlated with it, and does not make what is found with it too small.
    """

    def __init__(self, field: Field) -> None:
        self.field = field
        xy, k, r = field.xy_m, *field.shapes.shape
        square = np.sum((xy[:, None] - xy) ** 2, axis=-1)
        best = np.full(r, -np.inf)
        self._length_m, self._weights = np.empty(r), np.empty((k, r))
        for length in LENGTHS_M:
            value, vector = np.linalg.eigh(np.exp(-0.5 * square / length**2))
            turned = vector.T @ field.shapes
            for nugget in NUGGETS:
                inverse = 1.0 / (np.maximum(value, 0.0) + nugget)
                likelihood = np.sum(np.log(inverse)) - k * np.log(np.sum(turned**2 * inverse[:, None], axis=0))
                better = likelihood > best
                best[better], self._length_m[better] = likelihood[better], length
                self._weights[:, better] = vector @ (inverse[:, None] * turned[:, better])
                if better[0]:
                    self._inverse = (vector * inverse) @ vector.T
        self._least_open = float(self._open(xy).max())

    def shapes(self, xy_m: Array) -> Array:
        """(m, r) shapes at the places (m, 2)."""
        square = np.sum((xy_m[:, None] - self.field.xy_m) ** 2, axis=-1)
        found = np.empty((len(xy_m), self._weights.shape[1]))
        for length in np.unique(self._length_m):
            which = self._length_m == length
            found[:, which] = np.exp(-0.5 * square / length**2) @ self._weights[:, which]
        return found

    def known(self, xy_m: Array) -> NDArray[np.bool_]:
        """(m,) at which of the places (m, 2) the load is known: between taxels, not beyond the last ones."""
        found: NDArray[np.bool_] = self._open(xy_m) < self._least_open + KNOWN
        return found

    def _open(self, xy_m: Array) -> Array:
        """(m,) share of the load's variance that is left open at the places (m, 2)."""
        square = np.sum((xy_m[:, None] - self.field.xy_m) ** 2, axis=-1)
        near = np.exp(-0.5 * square / self._length_m[0] ** 2)
        left: Array = 1.0 - np.sum((near @ self._inverse) * near, axis=1)
        return left


def placed(xy_m: Array, pivot_m: Array, theta: Array) -> Array:
    """(m, 2) where taxels are that are believed to be at `xy_m`; the law `map_transform`."""
    x_mm, y_mm, rotation_deg, log_scale = theta[PLACE]
    angle = np.deg2rad(rotation_deg)
    turn = np.exp(log_scale) * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    found: Array = (xy_m - pivot_m) @ turn.T + pivot_m + np.array([x_mm, y_mm]) * 1e-3
    return found


class Sums:
    """Sums over time of m taxels' pressures (n, m), and of the courses with their slopes and memories, by fold."""

    def __init__(self, v: Array, field: Field, at_s: Array, fold: NDArray[np.intp]) -> None:
        """`at_s` (n,): when the rows were, on the simulation's clock; `fold` (n,) which each is held out with."""
        spline = CubicSpline(field.t_s, field.courses)
        courses, slopes = spline(at_s), spline(at_s, 1)
        late = [
            CubicSpline(field.t_s, low_pass(field.courses, field.step_s, tau_s))(at_s) - courses for tau_s in TAUS_S
        ]
        since = (at_s - at_s.mean())[:, None]
        basis = np.concatenate([np.ones((len(v), 1)), courses, slopes, since * slopes, *late], axis=1)
        self._parts = []
        for i in range(int(fold.max()) + 1):
            b, y = basis[fold == i], v[fold == i]
            self._parts.append((b.T @ b, b.T @ y, np.sum(y**2, axis=0)))

    @property
    def folds(self) -> int:
        """How many there are."""
        return len(self._parts)

    def without(self, fold: int | None = None) -> Projected:
        """All rows but those of a fold."""
        return self._of([part for i, part in enumerate(self._parts) if i != fold])

    def only(self, fold: int) -> Projected:
        """The rows of one fold."""
        return self._of([self._parts[fold]])

    def _of(self, parts: Sequence[tuple[Array, Array, Array]]) -> Projected:
        gram, cross, square = (np.sum(each, axis=0) for each in zip(*parts, strict=True))
        n = gram[0, 0]
        mean = gram[0, 1:] / n
        centred = gram[1:, 1:] - n * np.outer(mean, mean)
        rest = cross[1:] - np.outer(mean, cross[0])
        centred[np.diag_indices_from(centred)] *= 1.0 + _RIDGE
        upper = np.linalg.cholesky(centred).T
        z = solve_triangular(upper, rest, trans="T")
        return Projected(int(n), upper, z.T, square - cross[0] ** 2 / n - np.sum(z**2, axis=0))


@dataclass(frozen=True, slots=True, eq=False)
class Projected:
    """What of m taxels' signals the courses, their slopes and memories can say at all: q orthonormal coordinates."""

    rows: int
    upper: Array  # (q, q) from what was given to these
    z: Array  # (m, q)
    beyond: Array  # (m,) sum of squares that no mixture explains


class Askew:
    """The model above for m taxels `slots`; pressures in units of their noise `scale_pa` (m,)."""

    def __init__(
        self, between: Interpolation, layout: Layout, slots: NDArray[np.intp], scale_pa: Array, age_s: Array
    ) -> None:
        """`age_s` (m,): how long before the row's moment each was read."""
        self._between, self._layout, self._scale_pa, self._age_s = between, layout, scale_pa, age_s
        self.slots = slots
        self._every = np.flatnonzero(np.tile(PRESSURE_TAXELS, len(layout)))
        self._columns = np.searchsorted(self._every, slots)
        self._pivot_m = layout.xy_m[:, _CENTRE].mean(axis=0)
        near = neighbours(layout.xy_m)[np.ix_(self._every, self._every)].astype(float)
        self._number = near.sum(axis=1, keepdims=True)
        self._near = near / np.maximum(self._number, 1.0)

    def places_m(self, theta: Array, row: NDArray[np.intp]) -> Array:
        """(taxels, 2) of all taxels of the layout; `row` (n_triangles,) in whose place each triangle is."""
        slot = row[self._every // N_TAXELS] * N_TAXELS + self._every % N_TAXELS
        return placed(self._layout.xy_m.reshape(-1, 2)[slot], self._pivot_m, theta)

    def known(self, theta: Array, row: NDArray[np.intp]) -> NDArray[np.bool_]:
        """(m,) where the load is known."""
        return self._between.known(self.places_m(theta, row)[self._columns])

    def shapes(self, theta: Array, row: NDArray[np.intp]) -> Array:
        """(m, r) of the load on the taxels."""
        s = self._between.shapes(self.places_m(theta, row))
        if theta[SPREAD][0]:
            s = s + theta[SPREAD] * (self._near @ s - s * (self._number > 0))
        found: Array = s[self._columns]
        return found

    def coordinates(self, theta: Array, row: NDArray[np.intp], at: Projected) -> Array:
        """(m, q) the load."""
        s = self.shapes(theta, row) / self._scale_pa[:, None]
        offset, rate, *memory = theta[TIME]
        late = (offset - self._age_s)[:, None] * s
        found: Array = np.concatenate([s, late, rate * s, *(share * s for share in memory)], axis=1) @ at.upper.T
        return found

    def left(self, theta: Array, row: NDArray[np.intp], at: Projected) -> tuple[Array, Array, Array]:
        """(m, q) what is left of the taxels, (m,) their gains, (m, q) the load."""
        p = self.coordinates(theta, row, at)
        square, product = np.sum(p**2, axis=1), np.sum(p * at.z, axis=1)
        gain = (product + _PRIOR * usual_gain(square, product)) / (square + _PRIOR)
        return at.z - gain[:, None] * p, gain, p

    def fit(
        self, start: Array, free: Sequence[slice], row: NDArray[np.intp], at: Projected, kept: NDArray[np.bool_]
    ) -> tuple[Array, float]:
        """θ with the `free` parts at their best, and the sum of squares it leaves; taxels `kept` (m,) are asked."""
        theta, damping = start.copy(), 1e-3
        chosen = np.concatenate([np.arange(len(theta))[part] for part in free])
        left, gain, p = self.left(theta, row, at)
        cost = float(np.sum(left[kept] ** 2))
        for _ in range(MOST_STEPS):
            jacobian = np.empty((int(kept.sum()), p.shape[1], len(chosen)))
            unit = p / np.maximum(np.linalg.norm(p, axis=1, keepdims=True), 1e-12)
            for j, which in enumerate(chosen):
                nudged = theta.copy()
                nudged[which] += NUDGE[which]
                moved = gain[:, None] * (self.coordinates(nudged, row, at) - p) / NUDGE[which]
                moved -= np.sum(moved * unit, axis=1, keepdims=True) * unit
                jacobian[..., j] = -moved[kept]
            flat = jacobian.reshape(-1, len(chosen))
            normal, target = flat.T @ flat, flat.T @ left[kept].ravel()
            before = cost
            while damping < 1e6:
                tried = theta.copy()
                tried[chosen] -= np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), target)
                tried[SPREAD] = np.clip(tried[SPREAD], 0.0, MOST_SPREAD)
                rest = self.left(tried, row, at)
                after = float(np.sum(rest[0][kept] ** 2))
                if after < cost:
                    theta, (left, gain, p), cost, damping = tried, rest, after, max(damping / 5, 1e-9)
                    break
                damping *= 5
            if before - cost <= _SETTLED * before:
                break
        return theta, cost

    def held_out(
        self, start: Array, free: Sequence[slice], row: NDArray[np.intp], sums: Sums, kept: NDArray[np.bool_]
    ) -> tuple[float, Array]:
        """Mean square, in units of noise, that fits from `start` on leave of the folds they have not seen; their θ."""
        thetas, left = [], 0.0
        for i in range(sums.folds):
            seen, unseen = sums.without(i), sums.only(i)
            theta = self.fit(start, free, row, seen, kept)[0]
            gain = self.left(theta, row, seen)[1]
            rest = unseen.z - gain[:, None] * self.coordinates(theta, row, unseen)
            left += float(np.sum(rest[kept] ** 2) + np.sum(unseen.beyond[kept]))
            thetas.append(theta)
        rows = sum(sums.only(i).rows for i in range(sums.folds))
        return left / (rows * int(kept.sum())), np.stack(thetas)

    def as_another(self, theta: Array, at: Projected) -> Array:
        """(n_triangles, n_triangles) what is left of each triangle where it has the load of another's place."""
        n = len(self._layout)
        row = np.arange(n)
        p = self.coordinates(theta, row, at)
        usual = usual_gain(np.sum(p**2, axis=1), np.sum(p * at.z, axis=1))
        found = np.zeros((n, n))
        mine = self.slots // N_TAXELS
        for other in range(n):
            p = self.coordinates(theta, np.full(n, other), at)
            square, product = np.sum(p**2, axis=1), np.sum(p * at.z, axis=1)
            left = np.sum(at.z**2, axis=1) + _PRIOR * usual**2 - (product + _PRIOR * usual) ** 2 / (square + _PRIOR)
            found[:, other] = np.bincount(mine, left, n)
        return found


def usual_gain(square: Array, product: Array) -> float:
    """Of the taxels that bear most."""
    strong = square >= np.median(square)
    return float(np.median(product[strong] / np.maximum(square[strong], 1e-12)))
