"""Regressors of terms in blocks of triangles, and their inner products.

Both are in single precision. Regressors are grouped by the call that made them: a design with further regressors shares
the groups of the one it was extended from. Under a uniform load most regressors are equal in all triangles but for the
row weights, and are stored once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ..terms.term import TermColumns
from .nuisance import Nuisance

LEAST_GROUP = 32  # columns of a group, if there are so many
PROBE_STEP = 101  # rows between those that are compared first
Rows = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class ColumnGroup:
    """k columns in T blocks of N rows: `rows` (T, k, N) weighted, or (1, k, N) without `weights` (T, N)."""

    rows: Rows
    weights: Rows | None
    factors: Rows | None = None  # (T, k) of each column in each triangle

    @property
    def k(self) -> int:
        """Return the number of columns."""
        return int(self.rows.shape[1])

    def of_triangle(self, t: int) -> Rows:
        """Return the weighted columns (k, N) at triangle `t`."""
        rows = self.rows[t] if self.weights is None else self.rows[0] * self.weights[t]
        return np.asarray(rows if self.factors is None else rows * self.factors[t][:, None])

    def column(self, number: int) -> Rows:
        """Return a weighted column (T, N)."""
        rows = self.rows[:, number]
        rows = rows if self.weights is None else np.multiply(rows, self.weights)
        return rows if self.factors is None else rows * self.factors[:, number, None]

    def picked(self, numbers: NDArray[np.intp]) -> ColumnGroup:
        """Return the group of the columns `numbers`."""
        if len(numbers) == self.k:
            return self
        factors = None if self.factors is None else self.factors[:, numbers]
        return ColumnGroup(np.ascontiguousarray(self.rows[:, numbers]), self.weights, factors)

    def scaled(self, factors: Array) -> ColumnGroup:
        """Return the columns times `factors` (T, k)."""
        if np.all(factors == 1.0):
            return self
        product = factors if self.factors is None else self.factors * factors
        return replace(self, factors=product.astype(np.float32))

    def products_with(self, y: Rows) -> Array:
        """Return the inner products (T, k) with `y` (T, N)."""
        products = (
            np.matmul(self.rows, y[..., None])[..., 0] if self.weights is None else y * self.weights @ self.rows[0].T
        )
        return np.asarray(products if self.factors is None else products * self.factors, float)


@dataclass(frozen=True, eq=False)
class Atoms:
    """K regressors of terms in T blocks of N rows, and their inner products with the nuisance columns projected out."""

    parts: tuple[ColumnGroup, ...]  # the K columns in groups
    with_own: Array  # (T, b, K) products with the nuisance columns of each triangle
    gram: Rows  # (T, K, K) with own nuisance columns projected out
    shared: Array  # (T, K, s) products with the nuisance columns of the reference
    product: Array  # (T, K) covariance of noise in the regressor with that of the row
    square: Array  # (T, K) variance of noise in the regressor

    def _spans(self) -> Iterator[tuple[ColumnGroup, int, int]]:
        """Yield each group with the number of its first column and the number after its last."""
        end = 0
        for group in self.parts:
            start, end = end, end + group.k
            yield group, start, end

    def columns(self, numbers: NDArray[np.intp]) -> Rows:
        """Return the columns `numbers` (k,) as (T, k, N); numbers may repeat and need no order."""
        ends = np.cumsum([part.k for part in self.parts])
        group_of = np.searchsorted(ends, numbers, side="right").tolist()
        n_triangles, n = len(self.product), self.parts[0].rows.shape[2]
        columns = np.empty((n_triangles, len(group_of), n), np.float32)
        for k, (group, number) in enumerate(zip(group_of, numbers.tolist(), strict=True)):
            columns[:, k] = self.parts[group].column(number - ends[group])  # which counts from the end of its part
        return columns

    def products_with(self, y: Array, first: int = 0) -> Array:
        """Return the inner products (T, K − first) of the columns from number `first` on with `y` (T, N)."""
        rows = y.astype(np.float32)
        products = [np.empty((len(y), 0))]
        for group, start, end in self._spans():
            if end > first:
                products.append(group.products_with(rows)[:, max(first - start, 0) :])
        return np.concatenate(products, axis=1)

    def scaled(self, factors: Array) -> Atoms:
        """Return the atoms times `factors` (T, K)."""
        groups = [group.scaled(factors[:, start:end]) for group, start, end in self._spans()]
        gram = np.empty_like(self.gram)
        for of_triangle, own, factor in zip(gram, self.gram, factors, strict=True):
            of_triangle[:] = own * np.outer(factor, factor)
        return Atoms(
            tuple(groups), self.with_own * factors[:, None, :], gram, self.shared * factors[:, :, None],
            self.product * factors, self.square * factors**2,
        )  # fmt: skip

    def picked(self, used: NDArray[np.intp]) -> Atoms:
        """Return the atoms of the columns `used`, in rising order."""
        groups = [group.picked(used[(used >= start) & (used < end)] - start) for group, start, end in self._spans()]
        return Atoms(
            tuple(group for group in groups if group.k) or (groups[0],), self.with_own[:, :, used],
            self.gram[:, used][:, :, used], self.shared[:, used], self.product[:, used], self.square[:, used],
        )  # fmt: skip


def projected(atoms: Atoms, nuisance: Nuisance, other: Nuisance) -> Atoms:
    """Return the same columns with the nuisance columns `other` projected out instead of `nuisance`."""
    products = [
        _nuisance_products([group.of_triangle(t) for group in atoms.parts], other, t) for t in range(len(atoms.gram))
    ]
    with_own, shared = (np.stack(arrays) for arrays in zip(*products, strict=True))
    gram = np.empty_like(atoms.gram)
    for t, (before, own) in enumerate(zip(atoms.with_own, with_own, strict=True)):
        taken_up = before.T @ (nuisance.inverse[t] @ before)
        gram[t] = atoms.gram[t] + taken_up - own.T @ (other.inverse[t] @ own)
    return replace(atoms, with_own=with_own, gram=gram, shared=shared)


def make_atoms(
    blocks: Iterable[TermColumns],
    weights: Array,
    nuisance: Nuisance,
    joined: Atoms | None = None,
    at: NDArray[np.bool_] | None = None,
) -> Atoms:
    """Return the atoms of the columns of `blocks`, appended to those of `joined`; `weights` (N, T).

    `at` (T,): triangles in which the new columns are needed; their inner products in the others are 0.
    """
    new_groups, product, square = _weighted(blocks, weights)
    groups_before = () if joined is None else joined.parts
    n_triangles, k = product.shape
    k_before = 0 if joined is None else joined.product.shape[1]
    gram = np.zeros((n_triangles, k, k), np.float32)
    with_before = np.zeros((n_triangles, k_before, k), np.float32)
    with_own = np.zeros((n_triangles, nuisance.own.shape[1], k))
    shared = np.zeros((n_triangles, k, len(nuisance.kind)))
    for t in range(n_triangles) if at is None else np.flatnonzero(at).tolist():
        rows = np.concatenate([group.of_triangle(t) for group in new_groups])
        with_own[t], shared[t] = _nuisance_products([rows], nuisance, t)
        coefficients = nuisance.inverse[t] @ with_own[t]
        gram[t] = rows @ rows.T - with_own[t].T @ coefficients
        if joined is not None:
            products = np.concatenate([group.of_triangle(t) @ rows.T for group in groups_before])
            with_before[t] = products - joined.with_own[t].T @ coefficients
    if joined is None:
        return Atoms(new_groups, with_own, gram, shared, product, square)
    # Inner products of the columns of `joined` are kept; only those with new columns are computed.
    return Atoms(
        (*(group for group in groups_before if group.k), *new_groups),
        np.concatenate([joined.with_own, with_own], axis=2), _bordered(joined.gram, with_before, gram),
        np.concatenate([joined.shared, shared], axis=1),
        np.concatenate([joined.product, product], axis=1), np.concatenate([joined.square, square], axis=1),
    )  # fmt: skip


def _nuisance_products(groups: Sequence[Rows], nuisance: Nuisance, t: int) -> tuple[Array, Array]:
    """Return products (b, k) of a triangle's columns with its own nuisance columns, and (k, s) with the shared ones.

    The own nuisance columns are projected out of the shared ones.
    """
    wide_groups = [columns.astype(float) for columns in groups]
    with_own = np.concatenate([nuisance.own[t] @ columns.T for columns in wide_groups], axis=1)
    shared = np.concatenate([nuisance.with_shared(columns, t) for columns in wide_groups])
    return with_own, shared - with_own.T @ nuisance.own_of_shared[t]


def _weighted(blocks: Iterable[TermColumns], weights: Array) -> tuple[tuple[ColumnGroup, ...], Array, Array]:
    """Return the groups of columns of all blocks, and mean product and square (T, K) of their noise echo."""
    n, n_triangles = weights.shape
    factors = np.ascontiguousarray(weights.T)
    single = factors.astype(np.float32)
    groups: list[ColumnGroup] = []
    products: list[Array] = []
    squares: list[Array] = []
    for block in blocks:
        if block.by_triangle is not None:
            values = block.by_triangle[:, :, 0]
        else:
            assert block.whole is not None
            values = np.broadcast_to(block.whole, (n, n_triangles, block.whole.shape[-1]))
        if _is_equal_in_all_triangles(values):
            group = ColumnGroup(values[:, :1].transpose(1, 2, 0).astype(np.float32, order="C"), single)
        else:
            group = ColumnGroup(np.empty((n_triangles, values.shape[-1], n), np.float32), None)
            np.multiply(values.transpose(1, 2, 0), factors[:, None], out=group.rows, casting="same_kind")
        for i, sums in enumerate((products, squares)):
            if block.echo is None:
                sums.append(np.zeros((n_triangles, values.shape[-1])))
                continue
            echo = block.echo[i][:, :, 0] if block.by_triangle is not None else block.echo[i]
            sums.append(np.einsum("ntk,nt->tk", np.broadcast_to(echo, values.shape), weights**2))
        last_group = groups[-1] if groups else group
        if (
            last_group is not group
            and last_group.k < LEAST_GROUP
            and (last_group.weights is None) == (group.weights is None)
        ):
            groups[-1] = ColumnGroup(np.concatenate([last_group.rows, group.rows], axis=1), group.weights)
        else:
            groups.append(group)
    return tuple(groups), np.concatenate(products, axis=1), np.concatenate(squares, axis=1)


def _is_equal_in_all_triangles(values: Array) -> bool:
    """Return whether columns (N, T, k) are the same in all triangles."""
    if values.strides[1] == 0:
        return True
    return all(
        bool(np.array_equal(rows, np.broadcast_to(rows[:, :1], rows.shape))) for rows in (values[::PROBE_STEP], values)
    )


def _bordered(first: Rows, between: Rows, last: Rows) -> Rows:
    """Return the symmetric matrix (T, K + k, K + k) of its blocks (T, K, K), (T, K, k) and (T, k, k)."""
    n_triangles, before, new = between.shape
    matrix = np.empty((n_triangles, before + new, before + new), np.float32)
    matrix[:, :before, :before], matrix[:, :before, before:] = first, between
    matrix[:, before:, :before], matrix[:, before:, before:] = between.transpose(0, 2, 1), last
    return matrix
