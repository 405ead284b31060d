"""Gram matrix of all regressors of a block design, computed on demand from sums over triangles."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array


class PlacedColumns:
    """The atom of each of p columns, and the set of the T triangles where it is not zero."""

    def __init__(self, atom: NDArray[np.intp], mask: NDArray[np.bool_]) -> None:
        """Store `atom` (p,) and `mask` (p, T)."""
        self.atom = atom
        packed = np.packbits(mask, axis=1)
        _, first, place = np.unique(packed, axis=0, return_index=True, return_inverse=True)
        self.place: NDArray[np.intp] = place.reshape(-1)  # (p,) number of the column's set of triangles
        self.places = mask[first]  # (P, T)

    def summed(self, by_triangle: Array) -> Array:
        """Return the sums (p, ...) of values (T, K, ...) of the atoms over each column's triangles."""
        at_places = np.tensordot(self.places.astype(float), by_triangle, axes=1)
        return np.asarray(at_places[self.place, self.atom])


class GramMatrix:
    """Inner products (p, p), indexed as an array: `gram[rows, columns]` with slices or arrays of numbers.

    The inner product of two columns is a sum over the triangles that both have. Only the sums over every intersection
    of two sets of triangles are stored. The shared nuisance columns are projected out.
    """

    def __init__(
        self, columns: PlacedColumns, by_triangle: NDArray[np.float32], with_shared: Array, shared_inverse: Array,
        diagonal: Array,
    ) -> None:  # fmt: skip
        """Compute the sums of `by_triangle` (T, K, K) of atoms.

        `with_shared` (p, s): products with the shared nuisance columns, whose inverse Gram matrix is `shared_inverse`
        (s, s). `diagonal` (p,): the squares of the columns.
        """
        self._columns, self._diagonal = columns, diagonal
        self._with_shared, self._taken_up = with_shared, with_shared @ shared_inverse
        places = columns.places
        intersections = (places[:, None] & places).reshape(-1, places.shape[1])
        packed = np.packbits(intersections, axis=1)
        _, first, common = np.unique(packed, axis=0, return_index=True, return_inverse=True)
        sets = intersections[first]
        is_single = sets.sum(axis=1) == 1
        number = np.where(is_single, sets.argmax(axis=1), len(by_triangle) - 1 + np.cumsum(~is_single))
        self._common: NDArray[np.intp] = number[common].reshape(len(places), len(places))
        of_several = np.tensordot(sets[~is_single].astype(np.float32), by_triangle, axes=1)
        self._sums = np.concatenate([by_triangle, of_several])  # (T + C, K, K)

    def __getitem__(self, index: Any) -> Array:
        rows, columns = index if isinstance(index, tuple) else (index, slice(None))
        numbers = np.arange(len(self._diagonal))
        if isinstance(rows, slice):
            columns = numbers[columns] if isinstance(columns, slice) else np.asarray(columns)
            return self._at(numbers[rows].reshape(-1, *(1,) * columns.ndim), columns)
        rows = np.asarray(rows)
        if isinstance(columns, slice):
            return self._at(rows[..., None], numbers[columns])
        return self._at(rows, np.asarray(columns))

    def diagonal(self) -> Array:
        """Return the diagonal (p,)."""
        return self._diagonal

    def _at(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Array:
        """Return the products of columns whose numbers broadcast to each other."""
        place, atom = self._columns.place, self._columns.atom
        common = self._common[place[rows], place[columns]]
        products = self._sums[common, atom[rows], atom[columns]].astype(float)
        products -= np.einsum("...s,...s->...", self._taken_up[rows], self._with_shared[columns])
        return np.where(rows == columns, self._diagonal[rows], products)
