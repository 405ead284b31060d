"""The cover spreads a load: a taxel feels some of what lies on its neighbours.

Neighbours are pressure taxels at most REACH_MM apart where they really lie: those next to each other on a
triangle are 6.5 mm apart, those across the edges and corners of a flat tiling 8.0 mm; the next are beyond 10 mm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...skin.geometry import PRESSURE_TAXELS
from ..law import Array, Law, Moments, Operator, Parameter, Site, Values

REACH_MM = 9.0


def neighbours(xy_m: Array) -> NDArray[np.bool_]:
    """(slots, slots) which taxels are neighbours, for places (n_triangles, 12, 2) in m; a pad is nobody's."""
    xy = xy_m.reshape(-1, 2)
    near: NDArray[np.bool_] = np.hypot(*(xy[:, None] - xy).transpose(2, 0, 1)) <= REACH_MM * 1e-3
    pressure = np.tile(PRESSURE_TAXELS, len(xy_m))
    near &= pressure & pressure[:, None]
    np.fill_diagonal(near, False)
    return near


class _Spread:
    """q = P + k·(mean of the neighbours − P), by a table of neighbours: exact sums in the same order everywhere."""

    def __init__(self, values: Values, site: Site) -> None:
        near = neighbours(site.xy_m)[site.columns]
        number = near.sum(axis=1)
        self._columns, self._k = site.columns, np.where(number > 0, values["k"], 0.0)
        # The nearest columns of each row; where a taxel has fewer than another, its own with no weight.
        order = np.argsort(~near, axis=1, kind="stable")[:, : int(number.max(initial=0))]
        there = np.arange(order.shape[1]) < number[:, None]
        self._near = np.where(there, order, site.columns[:, None]).T
        self._weight = np.where(there, (self._k / np.maximum(number, 1))[:, None], 0.0).T

    def __call__(self, x: Array, moments: Moments) -> Array:
        q = x.copy()
        spread = (1.0 - self._k) * x[:, self._columns]
        for near, weight in zip(self._near, self._weight, strict=True):
            spread += weight * x[:, near]
        q[:, self._columns] = spread
        return q


def _inverse(values: Values, site: Site) -> Operator:
    forward = _Spread(values, site)
    slots = site.xy_m.size // 2
    # One row per unit load is a column of the matrix; diagonally dominant for k < 1/2, so it has an inverse.
    unspread = np.linalg.inv(forward(np.eye(slots), Moments(np.empty(0), np.empty(0), None)))
    return lambda x, moments: x @ unspread


LAW = Law(
    word="crosstalk",
    order=3,
    domain="pressure",
    equation="q = P + k·(mean of neighbouring taxels − P)",
    source="one step of diffusion on the graph of neighbours, q = (I − k·L)·P",
    parameters=(Parameter("k", "1", 0.0, 0.49, (0.05, 0.4), "share that comes from the neighbours"),),
    forward=_Spread,
    inverse=_inverse,
    inverse_is="exact where every neighbour gives a reading; one without a reading counts as unloaded",
    sees_all=True,
)
