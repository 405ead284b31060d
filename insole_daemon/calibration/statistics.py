"""Reduce the data of a least-squares fit to sums that can be added, so that the samples are read only once.

With x the scaled activation of m taxels and φ = (x, x², …) a row of d·m powers, power by power, the regressors of
Sorrentino et al. 2020, with the signs that make its CoP equations true, are

    Φ_f = A·φ      Φ_mx = A·φ·diag(y)      Φ_my = −A·φ·diag(x)

All three products ΦᵀΦ are therefore one Gram matrix times the arms, element by element, and weights and degrees can be
varied without the samples. Chamber rows, in which every taxel has its own equation, reduce to one d × d block per
taxel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_BATCH_ROWS = 4096  # rows per batch, which bounds the memory for their powers


def powers(x: Array, exponents: tuple[int, ...]) -> Array:
    """Return (n, d·m) powers of x (n, m): the first power of every taxel, then the second of every taxel, …"""
    n, m = x.shape
    rows = np.empty((n, len(exponents), m))
    for index, exponent in enumerate(exponents):
        np.power(x, exponent, out=rows[:, index])
    return rows.reshape(n, -1)


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """The part of n samples that follows a slow drift, by least squares, to be subtracted from both sides.

    Warming of a shoe shifts every taxel's baseline slightly, whatever the load. Without this correction the curves
    would bend to compensate for it.
    """

    basis: Array  # (n, 2) orthonormal: constant and linear in time
    powers_drift: Array  # (2, d·m)
    wrench_drift: Array  # (2, 3)

    @classmethod
    def of(cls, t_s: Array, x: Array, wrench: Array, exponents: tuple[int, ...]) -> Drift:
        """Estimate the drift from t_s (n,), x (n, m) and wrench (n, 3)."""
        basis = np.linalg.qr(np.stack([np.ones_like(t_s), t_s], axis=1))[0]
        powers_drift = np.zeros((2, x.shape[1] * len(exponents)))
        for leading in range(0, len(x), _BATCH_ROWS):
            rows = slice(leading, leading + _BATCH_ROWS)
            powers_drift += basis[rows].T @ powers(x[rows], exponents)
        return cls(basis, powers_drift, basis.T @ wrench)

    def rows(self, rows: slice) -> Drift:
        """Return the drift of some of the samples."""
        return Drift(self.basis[rows], self.powers_drift, self.wrench_drift)


@dataclass(frozen=True, slots=True, eq=False)
class ShoeSums:
    """Sums over n samples with a known wrench, for m taxels and d powers; a column has the unit of x to its power."""

    n: int
    gram: Array  # (d·m, d·m) Σ φφᵀ
    cross: Array  # (3, d·m) Σ φ·f_z, φ·m_x, φ·m_y
    squares: Array  # (3,) Σ f_z², m_x², m_y²

    @classmethod
    def of(cls, x: Array, wrench: Array, exponents: tuple[int, ...], drift: Drift | None = None) -> ShoeSums:
        """Sum over x (n, m) and wrench (n, 3) in N and N·m, both without their `drift`."""
        columns = x.shape[1] * len(exponents)
        gram, cross = np.zeros((columns, columns)), np.zeros((3, columns))
        if drift is not None:
            wrench = wrench - drift.basis @ drift.wrench_drift
        for leading in range(0, len(x), _BATCH_ROWS):
            rows = slice(leading, leading + _BATCH_ROWS)
            phi = powers(x[rows], exponents)
            if drift is not None:
                phi -= drift.basis[rows] @ drift.powers_drift
            gram += phi.T @ phi
            cross += wrench[rows].T @ phi
        return cls(len(x), gram, cross, (wrench**2).sum(axis=0))

    def __add__(self, other: ShoeSums) -> ShoeSums:
        return ShoeSums(
            self.n + other.n, self.gram + other.gram, self.cross + other.cross, self.squares + other.squares
        )

    def leading(self, columns: int) -> ShoeSums:
        """Return the sums of the first `columns` columns, which are the lower powers."""
        return ShoeSums(self.n, self.gram[:columns, :columns], self.cross[:, :columns], self.squares)

    def residual_squares(self, k: Array, arms: Array) -> Array:
        """Return (3,) sums of squared residuals of f_z, m_x, m_y for coefficients k (d·m,) and arms (3, d·m)."""
        effective = arms * k
        squares: Array = np.einsum("cj,cj->c", effective, effective @ self.gram - 2 * self.cross) + self.squares
        return np.maximum(squares, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class ChamberSums:
    """Sums over samples with a known pressure, per taxel, since taxels are invalid at different times."""

    n: Array  # (m,)
    gram: Array  # (m, d, d) Σ φφᵀ
    cross: Array  # (m, d) Σ φ·P
    squares: Array  # (m,) Σ P²

    @classmethod
    def of(cls, x: Array, valid: NDArray[np.bool_], pressure_pa: Array, exponents: tuple[int, ...]) -> ChamberSums:
        """Sum over x and valid (n, m) and pressure_pa (n,)."""
        m, d = x.shape[1], len(exponents)
        gram, cross = np.zeros((m, d, d)), np.zeros((m, d))
        for leading in range(0, len(x), _BATCH_ROWS):
            rows = slice(leading, leading + _BATCH_ROWS)
            phi = powers(x[rows], exponents).reshape(-1, d, m) * valid[rows, None]
            phi = phi.transpose(2, 1, 0)  # (m, d, rows)
            gram += phi @ phi.transpose(0, 2, 1)
            cross += phi @ pressure_pa[rows]
        return cls(valid.sum(axis=0).astype(float), gram, cross, (valid * pressure_pa[:, None] ** 2).sum(axis=0))

    def __add__(self, other: ChamberSums) -> ChamberSums:
        return ChamberSums(
            self.n + other.n, self.gram + other.gram, self.cross + other.cross, self.squares + other.squares
        )

    def leading(self, d: int) -> ChamberSums:
        """Return the sums of the first d powers."""
        return ChamberSums(self.n, self.gram[:, :d, :d], self.cross[:, :d], self.squares)

    def residual_squares(self, k: Array) -> Array:
        """Return (m,) sums of squared residuals for coefficients k (d·m,)."""
        by_taxel = k.reshape(self.gram.shape[1], -1).T
        product = np.einsum("mij,mj->mi", self.gram, by_taxel)
        squares: Array = np.einsum("mi,mi->m", by_taxel, product - 2 * self.cross) + self.squares
        return np.maximum(squares, 0.0)
