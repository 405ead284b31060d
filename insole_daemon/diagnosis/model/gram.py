"""Inner products of all columns of a regression in blocks, without a matrix of all of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array


class PlacedColumns:
    """Which atom each of p columns is, and at which of the T triangles."""

    def __init__(self, atom: NDArray[np.intp], mask: NDArray[np.bool_]) -> None:
        """`atom` (p,), `mask` (p, T)."""
        self.atom = atom
        packed = np.packbits(mask, axis=1)
        _, first, place = np.unique(packed, axis=0, return_index=True, return_inverse=True)
        self.place: NDArray[np.intp] = place.reshape(-1)  # (p,) number of a set of triangles
        self.places = mask[first]  # (P, T)

    def summed(self, by_triangle: Array) -> Array:
        """(p, ...) sums over the triangles of each column of values (T, K, ...) of the atoms."""
        at_places = np.tensordot(self.places.astype(float), by_triangle, axes=1)
        return np.asarray(at_places[self.place, self.atom])


class GramMatrix:
    """(p, p) inner products, read as an array is: `gram[rows, columns]` with slices or arrays of numbers.

    Two columns have in common the triangles that both are at, so that the sums over every set of triangles which two
    places share are all there is to keep. What the reference's columns take up is taken off.
    """

    def __init__(
        self, columns: PlacedColumns, by_triangle: Array, with_shared: Array, shared_inverse: Array, diagonal: Array
    ) -> None:
        """`by_triangle` (T, K, K) of atoms, `with_shared` (p, s), `shared_inverse` (s, s), `diagonal` (p,)."""
        self._columns, self._diagonal = columns, diagonal
        self._with_shared, self._taken_up = with_shared, with_shared @ shared_inverse
        places = columns.places
        both = (places[:, None] & places).reshape(-1, places.shape[1])
        packed = np.packbits(both, axis=1)
        _, first, common = np.unique(packed, axis=0, return_index=True, return_inverse=True)
        self._common: NDArray[np.intp] = common.reshape(len(places), len(places))
        self._sums = np.tensordot(both[first].astype(float), by_triangle, axes=1)  # (C, K, K)

    def __getitem__(self, index: Any) -> Array:
        rows, columns = index if isinstance(index, tuple) else (index, slice(None))
        every = np.arange(len(self._diagonal))
        if isinstance(rows, slice):
            columns = every[columns] if isinstance(columns, slice) else np.asarray(columns)
            return self._at(every[rows].reshape(-1, *(1,) * columns.ndim), columns)
        rows = np.asarray(rows)
        if isinstance(columns, slice):
            return self._at(rows[..., None], every[columns])
        return self._at(rows, np.asarray(columns))

    def diagonal(self) -> Array:
        """(p,)"""
        return self._diagonal

    def _at(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Array:
        """Products of columns whose numbers broadcast to each other."""
        place, atom = self._columns.place, self._columns.atom
        found = self._sums[self._common[place[rows], place[columns]], atom[rows], atom[columns]]
        found = found - np.einsum("...s,...s->...", self._taken_up[rows], self._with_shared[columns])
        return np.where(rows == columns, self._diagonal[rows], found)
