"""What the curve of a calibration may be off by: smooth functions of the activation."""

from __future__ import annotations

from dataclasses import dataclass

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

    def at(self, activation_count: Array) -> list[Array]:
        """Each spline, in counts, at activations of any shape; beyond the ends as at them."""
        low, high = float(self.knots[0]), float(self.knots[-1])
        table = BSpline(self.knots, np.eye(N_SPLINES), DEGREE)(np.linspace(low, high, N_TABLE)).T
        position = np.clip((activation_count - low) * ((N_TABLE - 1) / (high - low)), 0.0, N_TABLE - 1)
        left = np.minimum(position.astype(np.intp), N_TABLE - 2)
        share = position - left
        return [one[left] + share * np.diff(one)[left] for one in table]


@dataclass(frozen=True, eq=False)
class CurveShares:
    """By how much the curves of taxels are off: shares (T, 12, k) of `splines`."""

    splines: CurveSplines
    shares: Array

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
    off_count: Array, columns: Array, known: NDArray[np.bool_], std_count: Array, noise_count: Array
) -> Array:
    """(T, 12, k) shares of splines `columns` (N, T, 12, k) that counts (N, T, 12) are off by, in rows `known` (N, T).

    Ridge regression with the prior `std_count` (T,); `noise_count` (T, 12).
    """
    there = columns * known[..., None, None]
    gram = np.einsum("ntik,ntil->tikl", there, there)
    right = np.einsum("ntik,nti->tik", there, off_count)
    prior = (np.maximum(noise_count, 0.1) / std_count[:, None]) ** 2
    return np.asarray(np.linalg.solve(gram + prior[..., None, None] * np.eye(N_SPLINES), right[..., None])[..., 0])
