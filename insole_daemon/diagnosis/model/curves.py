"""Deviation of a calibration's static curves as a smooth function of the activation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from ...physics.law import Array
from ..observations.fitted_curves import invert_curve
from ..observations.static_curves import StaticCurves

N_SPLINES, DEGREE = 7, 3
N_TABLE = 1001  # points of a tabulated spline, linear between them
N_POINTS = 200  # of a corrected curve, to which a polynomial is fitted
LEAST_RANGE = 0.25  # of a corrected curve, in activations, relative to the present one
RANGE_QUANTILES = (0.001, 0.999)  # of the readings that are taken as the ends of their range


@dataclass(frozen=True, eq=False)
class CurveSplines:
    """Cubic B-spline basis over the range of activations of a recording.

    Source: C. de Boor, A Practical Guide to Splines, Springer 1978.
    """

    knots: Array

    @cached_property
    def _table(self) -> Array:
        """Return the values (k, N_TABLE) of each spline from the first knot to the last."""
        grid = np.linspace(self.knots[0], self.knots[-1], N_TABLE)
        return np.ascontiguousarray(BSpline(self.knots, np.eye(N_SPLINES), DEGREE)(grid).T)

    def at(self, activation_count: Array) -> Iterator[Array]:
        """Yield each spline, in counts, at activations of any shape; constant beyond the ends."""
        low, high = float(self.knots[0]), float(self.knots[-1])
        position = np.clip((activation_count - low) * ((N_TABLE - 1) / (high - low)), 0.0, N_TABLE - 1)
        index = np.minimum(position.astype(np.intp), N_TABLE - 2)
        fraction = position - index
        for values in self._table:
            yield values[index] + fraction * np.diff(values)[index]

    def of_triangle(self, activation_count: Array) -> Array:
        """Return all splines (12, k, N) at the activations (N, 12) of one triangle."""
        return np.stack(list(self.at(activation_count.T)), axis=1)


@dataclass(frozen=True, eq=False)
class CurveShares:
    """Deviation of the curves of taxels as coefficients of splines."""

    splines: CurveSplines
    shares: Array  # (T, 12, k)
    reached_count: Array  # (T, 12) largest activation of each taxel in the rows of the fit

    def off_at(self, activation_count: Array) -> Array:
        """Return the deviation (N, T, 12) of the curves in counts at activations (N, T, 12)."""
        deviation = np.empty(activation_count.shape)
        for t, shares in enumerate(self.shares):
            deviation[:, t] = _deviation(self.splines.of_triangle(activation_count[:, t]), shares)
        return deviation

    def corrected(self, curve: Array, top_count: float, row: int, taxel: int) -> Array:
        """Return coefficients (k,) of the corrected curve of taxel (row, taxel).

        `curve`: coefficients of the present one g, Pa, straight below zero and above the activation `top_count`. A
        pressure g(a) is read as a − d(a), d being the deviation. A taxel without rows in the fit keeps g, as does one
        whose deviation takes most of its range: its rows do not determine a curve.
        """
        if not self.shares[row, taxel].any():
            return curve
        count = np.linspace(float(self.splines.knots[0]), float(self.reached_count[row, taxel]), N_POINTS)
        splines = np.stack(list(self.splines.at(count)))
        read_count = np.maximum.accumulate(count - self.shares[row, taxel] @ splines)
        if np.ptp(read_count) < LEAST_RANGE * np.ptp(count):
            return curve
        return invert_curve(read_count, StaticCurves(curve, np.array(top_count)).pressure_pa(count))


def curve_splines(activation_count: Array, usable: NDArray[np.bool_]) -> CurveSplines:
    """Return the basis for activations (N, T, 12) of the `usable` taxels (T, 12)."""
    low, high = np.quantile(activation_count[:, usable], RANGE_QUANTILES)
    knots = np.linspace(min(float(low), 0.0), max(float(high), 1.0), N_SPLINES - DEGREE + 1)
    return CurveSplines(np.concatenate([[knots[0]] * DEGREE, knots, [knots[-1]] * DEGREE]))


def fit_curves(
    splines: CurveSplines, off_count: Array, at_count: Array, known: NDArray[np.bool_], std_count: Array,
    noise_count: Array,
) -> CurveShares:  # fmt: skip
    """Return the deviations `off_count` (N, T, 12) fitted as functions of the activations `at_count` (N, T, 12).

    Ridge regression in the rows `known` (N, T), with prior standard deviations `std_count` (T,) and the noise
    `noise_count` (T, 12).
    """
    ridge = _prior(std_count, noise_count)
    coefficients = [
        _coefficients(*_products(splines.of_triangle(at_count[:, t]), off_count[:, t], is_known), ridge[t])
        for t, is_known in enumerate(known.T)
    ]
    reached_count = np.max(at_count, axis=0, where=known[..., None], initial=1.0)
    return CurveShares(splines, np.stack(coefficients), reached_count)


def heldout_rest(
    splines: CurveSplines, off_count: Array, at_count: Array, known: NDArray[np.bool_], std_count: Array,
    noise_count: Array, fold: NDArray[np.intp],
) -> Array:  # fmt: skip
    """Return what curves leave of `off_count` (N, T, 12), each fitted as in `fit_curves` to the other folds of rows.

    `fold` (N,): the number of each row's fold. Beyond the activations of the fit a deviation is constant.
    """
    ridge, residual = _prior(std_count, noise_count), np.empty(off_count.shape)
    folds = [fold == k for k in np.unique(fold)]
    for t, is_known in enumerate(known.T):
        columns, deviation = splines.of_triangle(at_count[:, t]), off_count[:, t]
        products = [_products(columns, deviation, is_known & held) for held in folds]
        gram, right = (sum(of_fold[i] for of_fold in products) for i in (0, 1))
        for held, (own_gram, own_right) in zip(folds, products, strict=True):
            coefficients = _coefficients(gram - own_gram, right - own_right, ridge[t])
            held_count = _within(at_count[held, t], at_count[is_known & ~held, t])
            residual[held, t] = deviation[held] - _deviation(splines.of_triangle(held_count), coefficients)
    return residual


def _within(count: Array, fitted_count: Array) -> Array:
    """Return activations (n, 12) within the range of those of a fit (m, 12)."""
    if not len(fitted_count):
        return count
    return np.clip(count, fitted_count.min(axis=0), fitted_count.max(axis=0))


def _prior(std_count: Array, noise_count: Array) -> Array:
    """Return the ridge (T, 12) of a coefficient: variance of noise over that of the prior."""
    return np.asarray((np.maximum(noise_count, 0.1) / std_count[:, None]) ** 2)


def _products(columns: Array, off_count: Array, rows: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return inner products (12, k, k) of a triangle's columns (12, k, N) and (12, k) with `off_count` (N, 12)."""
    used_columns = columns[..., rows]
    right = np.matmul(used_columns, off_count[rows].T[..., None])[..., 0]
    return np.matmul(used_columns, used_columns.transpose(0, 2, 1)), np.asarray(right)


def _coefficients(gram: Array, right: Array, prior: Array) -> Array:
    """Return the ridge solution (12, k)."""
    return np.asarray(np.linalg.solve(gram + prior[:, None, None] * np.eye(N_SPLINES), right[..., None])[..., 0])


def _deviation(columns: Array, coefficients: Array) -> Array:
    """Return the deviation (N, 12) by a triangle's columns (12, k, N) and coefficients (12, k)."""
    return np.asarray(np.matmul(coefficients[:, None], columns)[:, 0].T)
