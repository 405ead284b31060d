"""Crosstalk: the cover spreads a load, so a taxel responds to part of its neighbours' load.

Neighbours are pressure taxels whose true positions are at most REACH_MM apart: adjacent taxels of a triangle are 6.5 mm
apart, those across edges and corners of a flat tiling 8.0 mm; the next ones are beyond 10 mm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...skin.geometry import PRESSURE_TAXELS
from ..law import Array, Law, Moments, Operator, Parameter, Site, Values

REACH_MM = 9.0


def neighbours(xy_m: Array) -> NDArray[np.bool_]:
    """Return (slots, slots) which taxels are neighbours, for positions (n_triangles, 12, 2) in m; pads have none."""
    xy = xy_m.reshape(-1, 2)
    is_near: NDArray[np.bool_] = np.hypot(*(xy[:, None] - xy).transpose(2, 0, 1)) <= REACH_MM * 1e-3
    pressure = np.tile(PRESSURE_TAXELS, len(xy_m))
    is_near &= pressure & pressure[:, None]
    np.fill_diagonal(is_near, False)
    return is_near


class _Spread:
    """Computes q = P + k·(mean of the neighbours − P) by a table, with sums in the same order on every machine."""

    def __init__(self, values: Values, site: Site) -> None:
        is_near = neighbours(site.xy_m)[site.columns]
        n_neighbours = is_near.sum(axis=1)
        self._columns, self._k = site.columns, np.where(n_neighbours > 0, values["k"], 0.0)
        # The neighbours of each row; rows with fewer are padded with the taxel itself, with weight 0.
        order = np.argsort(~is_near, axis=1, kind="stable")[:, : int(n_neighbours.max(initial=0))]
        is_neighbour = np.arange(order.shape[1]) < n_neighbours[:, None]
        self._near = np.where(is_neighbour, order, site.columns[:, None]).T
        self._weight = np.where(is_neighbour, (self._k / np.maximum(n_neighbours, 1))[:, None], 0.0).T

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
    # The response to a unit load is a column of the matrix, which is diagonally dominant for k < 1/2, so invertible.
    inverse_matrix = np.linalg.inv(forward(np.eye(slots), Moments(np.empty(0), np.empty(0), None)))
    return lambda x, moments: x @ inverse_matrix


LAW = Law(
    word="crosstalk",
    order=3,
    domain="pressure",
    equation="q = P + k·(mean of neighbouring taxels − P)",
    source="one step of diffusion on the graph of neighbours, q = (I − k·L)·P",
    parameters=(Parameter("k", "1", 0.0, 0.49, (0.05, 0.4), "share of the load from the neighbours"),),
    forward=_Spread,
    inverse=_inverse,
    inverse_is="exact where every neighbour gives a reading; one without a reading counts as unloaded",
    sees_all=True,
)
