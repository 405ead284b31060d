"""Whether the taxels are where, and who, the map says they are: triangles that are swapped, a map that lies askew.

Everything else a diagnosis says of a load with places depends on it, so it is asked first, under the static model alone:

    v_i(t) ≈ o_i + g_i · Σ_j A_ij(θ) · P_j(t + clock)

v: what the calibration makes of the readings, P: the simulated load, A: where taxel i is looked for in it. Offsets o and
gains g are each taxel's own, gains near the insole's; θ and the clock are common. The load between its taxels is
interpolated with a Gaussian process (kriging; Rasmussen & Williams 2006, section 2.2), whose length the load itself
tells, each taxel from the others.

P is few courses in time, so all sums over time are made once: least squares on their Gram matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import linear_sum_assignment

from ..physics.effects.crosstalk import neighbours
from ..physics.law import Array
from ..skin.geometry import N_TAXELS, PRESSURE_TAXELS
from ..skin.layout import Layout
from .field import Field

LENGTHS_M = np.geomspace(0.006, 0.05, 8)  # of the interpolation
NUGGETS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
REACH_M = 0.009  # from the nearest taxel: further outside nobody knows the load
GAIN_SPREAD = 0.15  # of calibrations, from taxel to taxel
THETA = ("x_mm", "y_mm", "rotation_deg", "log_scale", "k", "offset_s", "rate")
NUDGE = np.array([0.1, 0.1, 0.05, 1e-3, 1e-3, 1e-3, 1e-5])
PLACE, SPREAD, CLOCK = slice(0, 4), slice(4, 5), slice(5, 7)
MOST_STEPS = 25


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

    def shapes(self, xy_m: Array) -> Array:
        """(m, r) shapes at the places (m, 2)."""
        square = np.sum((xy_m[:, None] - self.field.xy_m) ** 2, axis=-1)
        found = np.empty((len(xy_m), self._weights.shape[1]))
        for length in np.unique(self._length_m):
            which = self._length_m == length
            found[:, which] = np.exp(-0.5 * square / length**2) @ self._weights[:, which]
        return found

    def reaches(self, xy_m: Array) -> NDArray[np.bool_]:
        """(m,) which of the places (m, 2) are near enough to be known of."""
        found: NDArray[np.bool_] = np.sum((xy_m[:, None] - self.field.xy_m) ** 2, axis=-1).min(axis=1) < REACH_M**2
        return found


def placed(xy_m: Array, pivot_m: Array, theta: Array) -> Array:
    """(m, 2) where taxels are that are believed to be at `xy_m`; the law `map_transform`."""
    x_mm, y_mm, rotation_deg, log_scale = theta[PLACE]
    angle = np.deg2rad(rotation_deg)
    turn = np.exp(log_scale) * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    found: Array = (xy_m - pivot_m) @ turn.T + pivot_m + np.array([x_mm, y_mm]) * 1e-3
    return found


class Sums:
    """Sums over time of m taxels' pressures (n, m) and the courses (n, r) with their slopes, by fold."""

    def __init__(self, v: Array, courses: Array, slopes: Array, t_s: Array, fold: NDArray[np.intp]) -> None:
        basis = np.concatenate([np.ones((len(v), 1)), courses, slopes, t_s[:, None] * slopes], axis=1)
        self._parts = []
        for i in range(int(fold.max()) + 1):
            b, y = basis[fold == i], v[fold == i]
            self._parts.append((b.T @ b, b.T @ y, np.sum(y**2, axis=0)))

    @property
    def folds(self) -> int:
        """How many there are."""
        return len(self._parts)

    def of(self, folds: Sequence[int]) -> Projected:
        """All rows of some folds."""
        gram, cross, square = (sum(each) for each in zip(*(self._parts[i] for i in folds), strict=True))
        n = gram[0, 0]
        mean = gram[0, 1:] / n
        centred = gram[1:, 1:] - n * np.outer(mean, mean)
        rest = cross[1:] - np.outer(mean, cross[0])
        centred[np.diag_indices_from(centred)] *= 1.0 + 1e-9
        upper = np.linalg.cholesky(centred).T
        z = solve_triangular(upper, rest, trans="T")
        return Projected(int(n), upper, z.T, square - cross[0] ** 2 / n - np.sum(z**2, axis=0))


@dataclass(frozen=True, slots=True, eq=False)
class Projected:
    """What of m taxels' signals the courses can say at all."""

    rows: int
    upper: Array  # (q, q) courses, slopes and slopes · t in orthonormal coordinates
    z: Array  # (m, q) the taxels in these
    beyond: Array  # (m,) sum of squares that no mixture of courses explains


class Askew:
    """The model above, for m taxels `slots` of a recording; pressures in units of their noise `scale` (m,) Pa."""

    def __init__(self, between: Interpolation, layout: Layout, slots: NDArray[np.intp], scale: Array) -> None:
        self._between, self._layout, self._slots, self._scale = between, layout, slots, scale
        self._every = np.flatnonzero(np.tile(PRESSURE_TAXELS, len(layout)))
        self._xy = layout.xy_m.reshape(-1, 2)[self._every]
        self._pivot = layout.xy_m[:, 3].mean(axis=0)
        near = neighbours(layout.xy_m)[np.ix_(self._every, self._every)].astype(float)
        self._near = near / np.maximum(near.sum(axis=1, keepdims=True), 1.0)
        self._columns = np.searchsorted(self._every, slots)

    def shapes(self, theta: Array, row: NDArray[np.intp]) -> Array:
        """(m, r) of the load on the taxels; `row` (n_triangles,) whose place each triangle has."""
        slot = row[self._every // N_TAXELS] * N_TAXELS + self._every % N_TAXELS
        xy = self._layout.xy_m.reshape(-1, 2)[slot]
        s = self._between.shapes(placed(xy, self._pivot, theta))
        if theta[SPREAD][0]:
            s = s + theta[SPREAD] * (self._near @ s - s)
        return s[self._columns]

    def reached(self, theta: Array) -> NDArray[np.bool_]:
        """(m,) taxels where the load is known."""
        return self._between.reaches(placed(self._xy[self._columns], self._pivot, theta))

    def _coordinates(self, theta: Array, row: NDArray[np.intp], at: Projected) -> Array:
        s = self.shapes(theta, row) / self._scale[:, None]
        offset, rate = theta[CLOCK]
        return np.concatenate([s, offset * s, rate * s], axis=1) @ at.upper.T

    def solved(self, theta: Array, row: NDArray[np.intp], at: Projected) -> tuple[Array, Array, Array]:
        """(m, q) what is left, (m,) gains, (m, q) the load, in orthonormal coordinates."""
        p = self._coordinates(theta, row, at)
        square, product = np.sum(p**2, axis=1), np.sum(p * at.z, axis=1)
        strong = square > np.median(square)
        usual = float(np.median(product[strong] / square[strong]))
        prior = 1.0 / GAIN_SPREAD**2
        gain = (product + prior * usual) / (square + prior)
        return at.z - gain[:, None] * p, gain, p

    def fit(
        self, start: Array, free: NDArray[np.bool_], row: NDArray[np.intp], at: Projected, kept: NDArray[np.bool_]
    ) -> Array:
        """θ with the `free` ones at their best; taxels that are not `kept` (m,) are not asked."""
        theta, damping = start.copy(), 1e-3
        left, gain, p = self.solved(theta, row, at)
        cost = float(np.sum(left[kept] ** 2))
        chosen = np.flatnonzero(free)
        for _ in range(MOST_STEPS):
            jacobian = np.empty((int(kept.sum()), p.shape[1], len(chosen)))
            unit = p / np.maximum(np.linalg.norm(p, axis=1, keepdims=True), 1e-12)
            for j, which in enumerate(chosen):
                nudged = theta.copy()
                nudged[which] += NUDGE[which]
                moved = gain[:, None] * (self._coordinates(nudged, row, at) - p) / NUDGE[which]
                moved -= np.sum(moved * unit, axis=1, keepdims=True) * unit
                jacobian[..., j] = -moved[kept]
            flat = jacobian.reshape(-1, len(chosen))
            normal, target = flat.T @ flat, flat.T @ left[kept].ravel()
            better = False
            while damping < 1e6:
                step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), -target)
                tried = theta.copy()
                tried[chosen] += step
                tried[SPREAD] = np.clip(tried[SPREAD], -0.1, 0.45)
                rest = self.solved(tried, row, at)
                after = float(np.sum(rest[0][kept] ** 2))
                if after < cost:
                    better = cost - after > 1e-7 * cost
                    theta, (left, gain, p), cost, damping = tried, rest, after, max(damping / 5, 1e-9)
                    break
                damping *= 5
            if not better:
                break
        return theta
