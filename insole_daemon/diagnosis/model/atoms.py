"""Columns of terms in the blocks of triangles, and their inner products.

Columns are kept in single precision, those that were made together in one part: a design with further columns shares
the parts of the one it was made from. Under a load that is the same everywhere most columns are the same in all
triangles but for the weights of the rows, and are kept once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ..terms.term import TermColumns
from .nuisance import Nuisance

TOGETHER = 32  # columns of one part, at the least where there are so many
PROBED = 101  # every so many rows show at once whether a column differs from triangle to triangle
Rows = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Part:
    """k columns in T blocks of N rows: `rows` (T, k, N) weighted, or (1, k, N) if `weights` (T, N) are still due."""

    rows: Rows
    weights: Rows | None

    @property
    def k(self) -> int:
        """The number of its columns."""
        return int(self.rows.shape[1])

    def of_triangle(self, t: int) -> Rows:
        """(k, N) weighted."""
        return np.asarray(self.rows[t] if self.weights is None else self.rows[0] * self.weights[t])

    def column(self, number: int) -> Rows:
        """(T, N) weighted."""
        rows = self.rows[:, number]
        return rows if self.weights is None else np.multiply(rows, self.weights)

    def picked(self, numbers: NDArray[np.intp]) -> Part:
        """Of the columns `numbers`; itself where that is all."""
        return self if len(numbers) == self.k else Part(np.ascontiguousarray(self.rows[:, numbers]), self.weights)

    def products_with(self, y: Rows) -> Array:
        """(T, k) inner products with rows (T, N)."""
        found = (
            np.matmul(self.rows, y[..., None])[..., 0] if self.weights is None else y * self.weights @ self.rows[0].T
        )
        return np.asarray(found, float)


@dataclass(frozen=True, eq=False)
class Atoms:
    """K columns of terms in T blocks of N rows, and their inner products once the calibration's error is taken out."""

    parts: tuple[Part, ...]  # the K columns, one part after the other
    with_own: Array  # (T, b, K) with the columns of each triangle's calibration
    gram: Array  # (T, K, K)
    raw: Array  # (T, K, K) without projection
    shared: Array  # (T, K, s) with the columns of the reference
    product: Array  # (T, K) of the echo of noise
    square: Array  # (T, K)

    def columns(self, numbers: NDArray[np.intp]) -> Rows:
        """(T, k, N) of the columns `numbers` (k,), which may come in any order and twice."""
        ends = np.cumsum([part.k for part in self.parts])
        which = np.searchsorted(ends, numbers, side="right").tolist()
        n_triangles, n = len(self.product), self.parts[0].rows.shape[2]
        found = np.empty((n_triangles, len(which), n), np.float32)
        for k, (i, number) in enumerate(zip(which, numbers.tolist(), strict=True)):
            found[:, k] = self.parts[i].column(number - ends[i])  # which counts from the end of its part
        return found

    def products_with(self, y: Array, first: int = 0) -> Array:
        """(T, K − first) inner products with rows `y` (T, N), of the columns from number `first` on."""
        rows = y.astype(np.float32)
        found, end = [np.empty((len(y), 0))], 0
        for part in self.parts:
            start, end = end, end + part.k
            if end > first:
                found.append(part.products_with(rows)[:, max(first - start, 0) :])
        return np.concatenate(found, axis=1)

    def picked(self, used: NDArray[np.intp]) -> Atoms:
        """Of the columns `used`, in rising order."""
        parts, end = [], 0
        for part in self.parts:
            start, end = end, end + part.k
            parts.append(part.picked(used[(used >= start) & (used < end)] - start))
        return Atoms(
            tuple(part for part in parts if part.k) or (parts[0],), self.with_own[:, :, used],
            self.gram[:, used][:, :, used], self.raw[:, used][:, :, used], self.shared[:, used],
            self.product[:, used], self.square[:, used],
        )  # fmt: skip


def projected(atoms: Atoms, nuisance: Nuisance) -> Atoms:
    """The same columns with other nuisances taken out."""
    every = [_with_nuisance([part.of_triangle(t) for part in atoms.parts], nuisance, t) for t in range(len(atoms.raw))]
    with_own, shared = (np.stack(each) for each in zip(*every, strict=True))
    gram = atoms.raw - np.matmul(with_own.transpose(0, 2, 1), np.matmul(nuisance.inverse, with_own))
    return replace(atoms, with_own=with_own, gram=gram, shared=shared)


def make_atoms(blocks: Iterable[TermColumns], weights: Array, nuisance: Nuisance, joined: Atoms | None = None) -> Atoms:
    """Columns of `blocks`, beside those of `joined`; `weights` (N, T)."""
    new, product, square = _weighted(blocks, weights)
    old = () if joined is None else joined.parts
    products = []
    for t in range(weights.shape[1]):
        rows = np.concatenate([part.of_triangle(t) for part in new])
        beside = np.concatenate([np.empty((0, len(rows)), np.float32), *(part.of_triangle(t) @ rows.T for part in old)])
        products.append((rows @ rows.T, beside, *_with_nuisance([rows], nuisance, t)))
    raw, beside, with_own, shared = (np.stack(each).astype(float) for each in zip(*products, strict=True))
    through = np.matmul(nuisance.inverse, with_own)
    gram = raw - np.matmul(with_own.transpose(0, 2, 1), through)
    if joined is None:
        return Atoms(new, with_own, gram, raw, shared, product, square)
    # Inner products of the columns that were there are kept: only those with the new ones are computed.
    projected = beside - np.matmul(joined.with_own.transpose(0, 2, 1), through)
    return Atoms(
        (*(part for part in old if part.k), *new),
        np.concatenate([joined.with_own, with_own], axis=2), _bordered(joined.gram, projected, gram),
        _bordered(joined.raw, beside, raw), np.concatenate([joined.shared, shared], axis=1),
        np.concatenate([joined.product, product], axis=1), np.concatenate([joined.square, square], axis=1),
    )  # fmt: skip


def _with_nuisance(parts: Sequence[Rows], nuisance: Nuisance, t: int) -> tuple[Array, Array]:
    """(b, k) products of a triangle's columns with its calibration's, and (k, s) with what these leave of others."""
    wide = [part.astype(float) for part in parts]
    with_own = np.concatenate([nuisance.own[t] @ part.T for part in wide], axis=1)
    shared = np.concatenate([nuisance.with_shared(part, t) for part in wide])
    return with_own, shared - with_own.T @ nuisance.own_of_shared[t]


def _weighted(blocks: Iterable[TermColumns], weights: Array) -> tuple[tuple[Part, ...], Array, Array]:
    """Columns, and mean product and square (T, K) of their echo; one block after the other."""
    n, n_triangles = weights.shape
    factors = np.ascontiguousarray(weights.T)
    single = factors.astype(np.float32)
    parts: list[Part] = []
    products: list[Array] = []
    squares: list[Array] = []
    for block in blocks:
        if block.by_triangle is not None:
            values = block.by_triangle[:, :, 0]
        else:
            assert block.whole is not None
            values = np.broadcast_to(block.whole, (n, n_triangles, block.whole.shape[-1]))
        if _is_same_everywhere(values):
            new = Part(values[:, :1].transpose(1, 2, 0).astype(np.float32, order="C"), single)
        else:
            new = Part(np.empty((n_triangles, values.shape[-1], n), np.float32), None)
            np.multiply(values.transpose(1, 2, 0), factors[:, None], out=new.rows, casting="same_kind")
        for i, found in enumerate((products, squares)):
            if block.echo is None:
                found.append(np.zeros((n_triangles, values.shape[-1])))
                continue
            echo = block.echo[i][:, :, 0] if block.by_triangle is not None else block.echo[i]
            found.append(np.einsum("ntk,nt->tk", np.broadcast_to(echo, values.shape), weights**2))
        last = parts[-1] if parts else new
        if last is not new and last.k < TOGETHER and (last.weights is None) == (new.weights is None):
            parts[-1] = Part(np.concatenate([last.rows, new.rows], axis=1), new.weights)
        else:
            parts.append(new)
    return tuple(parts), np.concatenate(products, axis=1), np.concatenate(squares, axis=1)


def _is_same_everywhere(values: Array) -> bool:
    """Whether columns (N, T, k) are the same in all triangles."""
    if values.strides[1] == 0:
        return True
    return all(bool(np.array_equal(own, np.broadcast_to(own[:, :1], own.shape))) for own in (values[::PROBED], values))


def _bordered(first: Array, beside: Array, last: Array) -> Array:
    """(T, K + k, K + k) symmetric, of its blocks (T, K, K), (T, K, k) and (T, k, k)."""
    return np.concatenate(
        [np.concatenate([first, beside], axis=2), np.concatenate([beside.transpose(0, 2, 1), last], axis=2)], axis=1
    )
