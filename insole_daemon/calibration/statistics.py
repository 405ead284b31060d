"""What a least-squares fit needs of its data, in sums that can be added: the samples are looked at once.

With x the scaled activation of m taxels and φ = (x, x², …) a row of d·m powers, power by power, the regressors of
Sorrentino et al. 2020 are, with the signs that make its CoP equations true,

    Φ_f = A·φ      Φ_mx = A·φ·diag(y)      Φ_my = −A·φ·diag(x)

so all three products ΦᵀΦ are one Gram matrix times the arms, element by element, and any weights and degrees can be
tried without the samples. Chamber rows, where every taxel has its own equation, leave blocks of d × d a taxel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_AT_ONCE = 4096  # rows whose powers are held together


def powers(x: Array, exponents: tuple[int, ...]) -> Array:
    """(n, d·m) of x (n, m): the first power of every taxel, then the second of every taxel, …"""
    n, m = x.shape
    rows = np.empty((n, len(exponents), m))
    for at, exponent in enumerate(exponents):
        np.power(x, exponent, out=rows[:, at])
    return rows.reshape(n, -1)


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """What of n samples goes with the course of a slow drift, by least squares: to be taken off both sides.

    A shoe that warms moves every taxel's rest a little, whatever presses; fitted with that in it, the curves would bend
    to make up for it.
    """

    course: Array  # (n, 2) orthonormal: a constant and a line in time
    of_powers: Array  # (2, d·m)
    of_wrench: Array  # (2, 3)

    @classmethod
    def of(cls, t_s: Array, x: Array, wrench: Array, exponents: tuple[int, ...]) -> Drift:
        """Of t_s (n,), x (n, m) and wrench (n, 3)."""
        course = np.linalg.qr(np.stack([np.ones_like(t_s), t_s], axis=1))[0]
        of_powers = np.zeros((2, x.shape[1] * len(exponents)))
        for first in range(0, len(x), _AT_ONCE):
            rows = slice(first, first + _AT_ONCE)
            of_powers += course[rows].T @ powers(x[rows], exponents)
        return cls(course, of_powers, course.T @ wrench)

    def rows(self, rows: slice) -> Drift:
        """The same for some of the samples."""
        return Drift(self.course[rows], self.of_powers, self.of_wrench)


@dataclass(frozen=True, slots=True, eq=False)
class ShoeSums:
    """Of n samples with a known wrench, on m taxels and d powers; unit of a column: that of x to its power."""

    n: int
    gram: Array  # (d·m, d·m) Σ φφᵀ
    against: Array  # (3, d·m) Σ φ·f_z, φ·m_x, φ·m_y
    squares: Array  # (3,) Σ f_z², m_x², m_y²

    @classmethod
    def of(cls, x: Array, wrench: Array, exponents: tuple[int, ...], drift: Drift | None = None) -> ShoeSums:
        """Of x (n, m) and wrench (n, 3) in N and N·m, both less their `drift`."""
        columns = x.shape[1] * len(exponents)
        gram, against = np.zeros((columns, columns)), np.zeros((3, columns))
        if drift is not None:
            wrench = wrench - drift.course @ drift.of_wrench
        for first in range(0, len(x), _AT_ONCE):
            rows = slice(first, first + _AT_ONCE)
            phi = powers(x[rows], exponents)
            if drift is not None:
                phi -= drift.course[rows] @ drift.of_powers
            gram += phi.T @ phi
            against += wrench[rows].T @ phi
        return cls(len(x), gram, against, (wrench**2).sum(axis=0))

    def __add__(self, other: ShoeSums) -> ShoeSums:
        return ShoeSums(
            self.n + other.n, self.gram + other.gram, self.against + other.against, self.squares + other.squares
        )

    def first(self, columns: int) -> ShoeSums:
        """The same with the first so many columns only: lower powers."""
        return ShoeSums(self.n, self.gram[:columns, :columns], self.against[:, :columns], self.squares)

    def residual_squares(self, k: Array, arms: Array) -> Array:
        """(3,) Σ of squared residuals of coefficients k (d·m,), by arms (3, d·m) of f_z, m_x, m_y."""
        effective = arms * k
        left: Array = np.einsum("cj,cj->c", effective, effective @ self.gram - 2 * self.against) + self.squares
        return np.maximum(left, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class ChamberSums:
    """Of samples with a known pressure: each taxel has its own, since each may be invalid at other times."""

    n: Array  # (m,)
    gram: Array  # (m, d, d) Σ φφᵀ
    against: Array  # (m, d) Σ φ·P
    squares: Array  # (m,) Σ P²

    @classmethod
    def of(cls, x: Array, valid: NDArray[np.bool_], pressure_pa: Array, exponents: tuple[int, ...]) -> ChamberSums:
        """Of x and valid (n, m) and pressure_pa (n,)."""
        m, d = x.shape[1], len(exponents)
        gram, against = np.zeros((m, d, d)), np.zeros((m, d))
        for first in range(0, len(x), _AT_ONCE):
            rows = slice(first, first + _AT_ONCE)
            phi = powers(x[rows], exponents).reshape(-1, d, m) * valid[rows, None]
            phi = phi.transpose(2, 1, 0)  # (m, d, rows)
            gram += phi @ phi.transpose(0, 2, 1)
            against += phi @ pressure_pa[rows]
        return cls(valid.sum(axis=0).astype(float), gram, against, (valid * pressure_pa[:, None] ** 2).sum(axis=0))

    def __add__(self, other: ChamberSums) -> ChamberSums:
        return ChamberSums(
            self.n + other.n, self.gram + other.gram, self.against + other.against, self.squares + other.squares
        )

    def first(self, d: int) -> ChamberSums:
        """The same with the first d powers only."""
        return ChamberSums(self.n, self.gram[:, :d, :d], self.against[:, :d], self.squares)

    def residual_squares(self, k: Array) -> Array:
        """(m,) Σ of squared residuals of coefficients k (d·m,)."""
        own = k.reshape(self.gram.shape[1], -1).T
        product = np.einsum("mij,mj->mi", self.gram, own)
        left: Array = np.einsum("mi,mi->m", own, product - 2 * self.against) + self.squares
        return np.maximum(left, 0.0)
