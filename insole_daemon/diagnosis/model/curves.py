"""What the curve of a calibration may be off by: smooth functions of the activation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from ...physics.law import Array

N_SPLINES, DEGREE = 7, 3
N_TABLE = 1001  # of a spline, between which it is straight
CHANGED_DEGREE = 6  # of the polynomial of a curve that was off
INNER = (0.001, 0.999)  # quantiles that stand for the ends of the readings


@dataclass(frozen=True, eq=False)
class CurveSplines:
    """Cubic B-splines over the activations that a recording reaches (de Boor 1978)."""

    knots: Array

    @cached_property
    def _table(self) -> Array:
        """(k, N_TABLE) of each spline from the first knot to the last."""
        grid = np.linspace(self.knots[0], self.knots[-1], N_TABLE)
        return np.ascontiguousarray(BSpline(self.knots, np.eye(N_SPLINES), DEGREE)(grid).T)

    def at(self, activation_count: Array) -> Iterator[Array]:
        """Each spline, in counts, at activations of any shape; beyond the ends as at them."""
        low, high = float(self.knots[0]), float(self.knots[-1])
        position = np.clip((activation_count - low) * ((N_TABLE - 1) / (high - low)), 0.0, N_TABLE - 1)
        left = np.minimum(position.astype(np.intp), N_TABLE - 2)
        share = position - left
        for one in self._table:
            yield one[left] + share * np.diff(one)[left]

    def of_triangle(self, activation_count: Array) -> Array:
        """(12, k, N) all splines at the activations (N, 12) of one triangle."""
        return np.stack(list(self.at(activation_count.T)), axis=1)


@dataclass(frozen=True, eq=False)
class CurveShares:
    """By how much the curves of taxels are off: shares (T, 12, k) of `splines`."""

    splines: CurveSplines
    shares: Array

    def off_at(self, activation_count: Array) -> Array:
        """(N, T, 12) counts that the curves are off by at activations (N, T, 12)."""
        found = np.empty(activation_count.shape)
        for t, shares in enumerate(self.shares):
            found[:, t] = _off(self.splines.of_triangle(activation_count[:, t]), shares)
        return found

    def changed(self, curve: Array, row: int, taxel: int) -> Array:
        """(k,) coefficients of a curve g that tells g(a + off(a)), `off` being what taxel (row, taxel) is off by."""
        low, high = float(self.splines.knots[0]), float(self.splines.knots[-1])
        grid = np.linspace(low, high, 200)
        off = sum(share * each for share, each in zip(self.shares[row, taxel], self.splines.at(grid), strict=True))
        told = np.polynomial.polynomial.polyval(np.maximum(grid + off, 0.0), curve)
        told += curve[1] * np.minimum(grid + off, 0.0)
        return np.asarray(np.polynomial.Polynomial.fit(grid, told, CHANGED_DEGREE).convert().coef)


def curve_splines(activation_count: Array, usable: NDArray[np.bool_]) -> CurveSplines:
    """For activations (N, T, 12) of the taxels `usable` (T, 12)."""
    low, high = np.quantile(activation_count[:, usable], INNER)
    knots = np.linspace(min(float(low), 0.0), max(float(high), 1.0), N_SPLINES - DEGREE + 1)
    return CurveSplines(np.concatenate([[knots[0]] * DEGREE, knots, [knots[-1]] * DEGREE]))


def fit_curves(
    splines: CurveSplines, off_count: Array, at_count: Array, known: NDArray[np.bool_], std_count: Array,
    noise_count: Array,
) -> CurveShares:  # fmt: skip
    """What counts (N, T, 12) are off by as functions of activations `at_count` (N, T, 12), in rows `known` (N, T).

    Ridge regression with the prior `std_count` (T,); `noise_count` (T, 12).
    """
    prior = _prior(std_count, noise_count)
    shares = [
        _shares(*_products(splines.of_triangle(at_count[:, t]), off_count[:, t], own), prior[t])
        for t, own in enumerate(known.T)
    ]
    return CurveShares(splines, np.stack(shares))


def heldout_rest(
    splines: CurveSplines, off_count: Array, at_count: Array, known: NDArray[np.bool_], std_count: Array,
    noise_count: Array, fold: NDArray[np.intp],
) -> Array:  # fmt: skip
    """(N, T, 12) counts that are left of `off_count` by curves that were fitted as above to the other folds of rows.

    `fold` (N,): the number of each row's.
    """
    prior, rest = _prior(std_count, noise_count), np.empty(off_count.shape)
    folds = [fold == k for k in np.unique(fold)]
    for t, own in enumerate(known.T):
        columns, off = splines.of_triangle(at_count[:, t]), off_count[:, t]
        every = [_products(columns, off, own & held) for held in folds]
        gram, right = (sum(each[i] for each in every) for i in (0, 1))
        for held, (own_gram, own_right) in zip(folds, every, strict=True):
            shares = _shares(gram - own_gram, right - own_right, prior[t])
            rest[held, t] = off[held] - _off(columns[..., held], shares)
    return rest


def _prior(std_count: Array, noise_count: Array) -> Array:
    """(T, 12) of a share, in variances of the noise."""
    return np.asarray((np.maximum(noise_count, 0.1) / std_count[:, None]) ** 2)


def _products(columns: Array, off_count: Array, rows: NDArray[np.bool_]) -> tuple[Array, Array]:
    """(12, k, k) and (12, k) inner products of a triangle's columns (12, k, N), and with `off_count` (N, 12)."""
    own = columns[..., rows]
    right = np.matmul(own, off_count[rows].T[..., None])[..., 0]
    return np.matmul(own, own.transpose(0, 2, 1)), np.asarray(right)


def _shares(gram: Array, right: Array, prior: Array) -> Array:
    """(12, k)"""
    return np.asarray(np.linalg.solve(gram + prior[:, None, None] * np.eye(N_SPLINES), right[..., None])[..., 0])


def _off(columns: Array, shares: Array) -> Array:
    """(N, 12) of a triangle's columns (12, k, N) and shares (12, k)."""
    return np.asarray(np.matmul(shares[:, None], columns)[:, 0].T)
