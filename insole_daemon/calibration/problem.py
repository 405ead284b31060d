"""The fused problem of Sorrentino et al. 2020: chamber pressure and shoe wrench in one weighted, regularised fit.

    k* = argmin Σ_c w_c ‖Φ_c k − b_c‖² + Σ_i w_i ‖Φ_i k_i − P‖² + Σ_i (k_i − k⁰_i)ᵀ R_i (k_i − k⁰_i)

c are the channels f_z, m_x, m_y of the shoe, i the taxels in the chamber. All activations are divided by one scale, so
that the columns have similar size and the penalty is free of units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .samples import Samples
from .smoothing import FRAME
from .solver import Constraints
from .statistics import ChamberSums, Drift, ShoeSums

Array = NDArray[np.float64]

FOLDS = 5
_GRID = 9  # points of a curve at which its slope is constrained


@dataclass(frozen=True, slots=True, eq=False)
class Weights:
    """Weight of one squared residual: the inverse of its variance times the number of correlated samples."""

    shoe: Array  # (3,) f_z in 1/N², moments in 1/(N·m)²
    chamber: Array  # (m,) 1/Pa²


@dataclass(frozen=True, slots=True, eq=False)
class Penalty:
    """Quadratic penalty on the distance of the coefficients from `target`."""

    blocks: Array  # (m, d, d)
    target: Array  # (m, d)


@dataclass(frozen=True, slots=True, eq=False)
class FusedProblem:
    """Data of m taxels in folds along time, for d powers of the scaled activation."""

    exponents: tuple[int, ...]
    scale_count: float
    arms: Array  # (3, m) A, A·y, −A·x: contribution of a taxel's pressure to f_z, m_x, m_y
    shoe: tuple[ShoeSums, ...]  # FOLDS elements; empty without a shoe
    chamber: tuple[ChamberSums, ...]

    @property
    def m(self) -> int:
        """Return the number of taxels."""
        return int(self.arms.shape[1])

    @property
    def tiled_arms(self) -> Array:
        """Return (3, d·m) the arms for every power."""
        return np.tile(self.arms, len(self.exponents))

    def with_degree(self, d: int) -> FusedProblem:
        """Return the problem with the first d powers only."""
        return replace(
            self,
            exponents=self.exponents[:d],
            shoe=tuple(sums.leading(d * self.m) for sums in self.shoe),
            chamber=tuple(sums.leading(d) for sums in self.chamber),
        )

    def without(self, fold: int) -> FusedProblem:
        """Return the problem without one fold."""
        return replace(
            self,
            shoe=tuple(sums for index, sums in enumerate(self.shoe) if index != fold),
            chamber=tuple(sums for index, sums in enumerate(self.chamber) if index != fold),
        )

    def only(self, fold: int) -> FusedProblem:
        """Return the problem with one fold alone."""
        return replace(self, shoe=self.shoe[fold : fold + 1], chamber=self.chamber[fold : fold + 1])

    def equations(self, weights: Weights, penalty: Penalty | None) -> tuple[Array, Array]:
        """Return H (d·m, d·m) and g (d·m,) of min ½ kᵀHk + gᵀk."""
        d, m = len(self.exponents), self.m
        h, g = np.zeros((d * m, d * m)), np.zeros(d * m)
        if self.shoe:
            arms = self.tiled_arms
            h += sum(fold.gram for fold in self.shoe) * (arms.T @ (weights.shoe[:, None] * arms))
            g -= sum(np.einsum("c,cj,cj->j", weights.shoe, arms, fold.cross) for fold in self.shoe)
        blocks = np.zeros((m, d, d))
        for fold in self.chamber:
            blocks += weights.chamber[:, None, None] * fold.gram
            g -= (weights.chamber[:, None] * fold.cross).T.ravel()
        if penalty is not None:
            blocks += penalty.blocks
            g -= np.einsum("mij,mj->im", penalty.blocks, penalty.target).ravel()
        taxel = np.arange(m)
        for i in range(d):
            for j in range(d):
                h[i * m + taxel, j * m + taxel] += blocks[:, i, j]
        return h, g

    def residual_squares(self, k: Array) -> tuple[Array, Array]:
        """Return sums of squared residuals: (3,) of the shoe's channels, (m,) of the taxels in the chamber."""
        arms = self.tiled_arms
        shoe = sum((sums.residual_squares(k, arms) for sums in self.shoe), np.zeros(3))
        return shoe, sum((sums.residual_squares(k) for sums in self.chamber), np.zeros(self.m))

    @property
    def n_shoe(self) -> int:
        """Return the number of samples of the shoe."""
        return sum(sums.n for sums in self.shoe)

    @property
    def n_chamber(self) -> Array:
        """Return (m,) the number of samples in the chamber."""
        return sum((sums.n for sums in self.chamber), np.zeros(self.m))

    def limits(self, common: Array, end_count: float, steepest: float) -> Constraints:
        """Return constraints on the slopes up to `end_count`: from 0 to `steepest` times the common curve's steepest
        slope.

        `common` (d,) are the coefficients of the common curve.
        """
        d, m = len(self.exponents), self.m
        x = np.linspace(0.0, end_count / self.scale_count, _GRID)
        slopes = np.stack([p * x ** max(p - 1, 0) for p in self.exponents])  # (d, grid)
        rows = np.zeros((m, _GRID, d, m))
        taxel = np.arange(m)
        rows[taxel, :, :, taxel] = slopes.T
        highest_slope = max(float((common @ slopes).max()), 1e-6) * steepest
        return Constraints(rows.reshape(m * _GRID, d * m), np.zeros(m * _GRID), np.full(m * _GRID, highest_slope))


def build_fused_problem(
    samples: Sequence[Samples], slots: NDArray[np.intp], exponents: tuple[int, ...], scale_count: float,
    rest_count: Array | None = None,
) -> FusedProblem:  # fmt: skip
    """Build the problem of the taxels `slots` (m,).

    `rest_count` (slots,), if given, replaces the unloaded counts of each trial as the origin of the activation.
    """
    layout = samples[0].trial.layout
    x, y = layout.xy_m.reshape(-1, 2)[slots].T
    arms = layout.taxel_area_m2 * np.stack([np.ones_like(x), y, -x])
    shoe: list[ShoeSums | None] = [None] * FOLDS
    chamber: list[ChamberSums | None] = [None] * FOLDS
    for trial_samples in samples:
        activation = (
            trial_samples.activation
            if rest_count is None
            else trial_samples.activation + (rest_count - trial_samples.trial.rest_count)
        )
        scaled = activation[:, slots] / scale_count
        valid = trial_samples.valid[:, slots]
        if trial_samples.trial.kind == "shoe":
            is_complete = valid.all(axis=1)
            scaled, wrench = scaled[is_complete], trial_samples.reference[is_complete]
            drift = Drift.of(trial_samples.t_s[is_complete], scaled, wrench, exponents) if rest_count is None else None
        for fold, rows in enumerate(_fold_slices(len(scaled))):
            if trial_samples.trial.kind == "chamber":
                sums = ChamberSums.of(scaled[rows], valid[rows], trial_samples.reference[rows, 0], exponents)
                chamber[fold] = sums if chamber[fold] is None else chamber[fold] + sums  # type: ignore[operator]
            else:
                fold_drift = None if drift is None else drift.rows(rows)
                shoe_sums = ShoeSums.of(scaled[rows], wrench[rows], exponents, fold_drift)
                shoe[fold] = shoe_sums if shoe[fold] is None else shoe[fold] + shoe_sums  # type: ignore[operator]
    return FusedProblem(
        exponents, scale_count, arms,
        tuple(s for s in shoe if s is not None), tuple(c for c in chamber if c is not None),
    )  # fmt: skip


def _fold_slices(n: int) -> list[slice]:
    """Return FOLDS intervals, half a filter frame apart, so that no sample influences two folds."""
    edges = np.linspace(0, n, FOLDS + 1).astype(int).tolist()
    gap = FRAME // 2 if n > 4 * FOLDS * FRAME else 0
    return [slice(a + (gap if a else 0), b) for a, b in pairwise(edges)]
