"""Swapped triangles: two triangles report under each other's identity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...skin.geometry import N_TAXELS
from ...skin.layout import Layout
from ..law import Array, Law, Operator, Parameter, Site, Values


def _source_slots(values: Values, layout: Layout) -> NDArray[np.intp]:
    """Return (12 · n_triangles,) the slot whose load each slot reports."""
    rows = layout.rows
    first, second = (rows[int(board), int(triangle)] for board, triangle in values["pair"])
    row = np.arange(len(layout))
    row[[first, second]] = second, first
    slots: NDArray[np.intp] = (row[:, None] * N_TAXELS + np.arange(N_TAXELS)).ravel()
    return slots


def _exchange(values: Values, site: Site) -> Operator:
    slots = _source_slots(values, site.layout)
    return lambda x, moments: x[:, slots]


def _places(values: Values, xy_m: Array, layout: Layout) -> Array:
    return xy_m.reshape(-1, 2)[_source_slots(values, layout)].reshape(xy_m.shape)


LAW = Law(
    word="swapped_triangles",
    order=1,
    domain="pressure",
    equation="the first of the pair reports the load of the second, the second that of the first",
    source="a map that confuses two triangles: facts of wiring, wrong in many published configurations of this skin",
    parameters=(Parameter("pair", "1", 0, 15, (0, 15), "(board, triangle) of both", "pair", whole=True),),
    forward=_exchange,
    inverse=_exchange,
    inverse_is="exact: the same again",
    sees_all=True,
    places=_places,
)
