"""Bounds on the load that missing taxels may bear, from those around them.

A wrench that leaves taxels out is short by what those bear, and nobody knows how much that is. Each may bear anything
from nothing to as much as the most loaded valid one among its NEAREST: a sole and a cover press no sharper peak than
that on ten taxels of a triangle together. So the error of f_z lies between 0 and Σ A p_most, and that of a
moment between the sum over the taxels on one side of its axis and that over the other side's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..skin.geometry import PRESSURE_TAXELS
from ..skin.layout import Layout

NEAREST = 24  # a triangle's other nine and those of its neighbours that face it


@dataclass(frozen=True, slots=True)
class _Gap:
    """The m taxels that are missing from a cycle."""

    nearest: NDArray[np.intp]  # (m, NEAREST) their neighbours
    lone: NDArray[np.bool_]  # (m,) none of the neighbours is valid
    any_lone: bool
    one_side: NDArray[np.float64]  # (3, m) of the rows of the wrench
    other_side: NDArray[np.float64]


class MissingArea:
    """The largest error of a wrench that some of one foot's pressure taxels are missing from."""

    def __init__(self, layout: Layout, rows: NDArray[np.float64]) -> None:
        """`rows` (3, 12 · n_triangles): the wrench is rows @ pressure."""
        self._pressure_taxel = np.tile(PRESSURE_TAXELS, len(layout))
        taxel = np.flatnonzero(self._pressure_taxel)
        xy = layout.xy_m.reshape(-1, 2)
        distance = np.hypot(*(xy[:, None] - xy[None, taxel]).transpose(2, 0, 1))
        distance[taxel, np.arange(len(taxel))] = np.inf
        self._nearest = taxel[np.argsort(distance, axis=1, kind="stable")[:, : min(NEAREST, len(taxel) - 1)]]
        self._one_side, self._other_side = np.maximum(rows, 0), np.maximum(-rows, 0)
        self._marks: bytes | None = None  # of the cycle that `_gap` was made for
        self._gap = self._gap_of(self._pressure_taxel)

    def __call__(self, pressure: NDArray[np.float64], valid: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the largest errors (3,) of f_z in N, m_x and m_y in N·m.

        `pressure` in Pa and `valid` are (12 · n_triangles,); pressure is 0 where it is not valid.
        """
        marks = valid.tobytes()
        if marks != self._marks:  # which are missing hardly ever changes
            self._marks, self._gap = marks, self._gap_of(valid)
        gap = self._gap
        most = pressure[gap.nearest].max(axis=1, initial=0.0)
        if gap.any_lone:  # deep inside a hole: anything that is borne anywhere
            most[gap.lone] = pressure.max(initial=0.0)
        largest: NDArray[np.float64] = np.maximum(
            (gap.one_side * most).sum(axis=1), (gap.other_side * most).sum(axis=1)
        )
        return largest

    def _gap_of(self, valid: NDArray[np.bool_]) -> _Gap:
        missing = np.flatnonzero(self._pressure_taxel & ~valid)
        nearest = self._nearest[missing]
        lone: NDArray[np.bool_] = np.logical_not(valid[nearest].any(axis=1))
        return _Gap(nearest, lone, bool(lone.any()), self._one_side[:, missing], self._other_side[:, missing])
