"""The fused problem of Sorrentino et al. 2020: chamber pressure and shoe wrench in one weighted, regularised fit.

    k* = argmin Σ_c w_c ‖Φ_c k − b_c‖² + Σ_i w_i ‖Φ_i k_i − P‖² + Σ_i (k_i − k⁰_i)ᵀ R_i (k_i − k⁰_i)

with c the channels f_z, m_x, m_y of the shoe and i the taxels in the chamber. Activations are divided by one scale for
all taxels, so that columns are of one size and no unit enters the weights of the penalty.
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
_GRID = 9  # points of a curve at which its slope is limited


@dataclass(frozen=True, slots=True, eq=False)
class Weights:
    """What one squared residual costs: 1 over its variance, by as many samples as say the same."""

    shoe: Array  # (3,) of f_z 1/N², of the moments 1/(N·m)²
    chamber: Array  # (m,) 1/Pa²


@dataclass(frozen=True, slots=True, eq=False)
class Penalty:
    """Of leaving the curves `target`."""

    blocks: Array  # (m, d, d)
    target: Array  # (m, d)


@dataclass(frozen=True, slots=True, eq=False)
class FusedProblem:
    """Data of m taxels, in parts along time; d powers of the scaled activation."""

    exponents: tuple[int, ...]
    scale_count: float
    arms: Array  # (3, m) A, A·y, −A·x: what a taxel's pressure adds to f_z, m_x, m_y
    shoe: tuple[ShoeSums, ...]  # FOLDS of them; empty without a shoe
    chamber: tuple[ChamberSums, ...]

    @property
    def m(self) -> int:
        """How many taxels."""
        return int(self.arms.shape[1])

    @property
    def wide_arms(self) -> Array:
        """(3, d·m)."""
        return np.tile(self.arms, len(self.exponents))

    def lower(self, d: int) -> FusedProblem:
        """With the first d powers only."""
        return replace(
            self,
            exponents=self.exponents[:d],
            shoe=tuple(each.first(d * self.m) for each in self.shoe),
            chamber=tuple(each.first(d) for each in self.chamber),
        )

    def without(self, fold: int) -> FusedProblem:
        """All but one part."""
        return replace(
            self,
            shoe=tuple(each for at, each in enumerate(self.shoe) if at != fold),
            chamber=tuple(each for at, each in enumerate(self.chamber) if at != fold),
        )

    def only(self, fold: int) -> FusedProblem:
        """One part."""
        return replace(self, shoe=self.shoe[fold : fold + 1], chamber=self.chamber[fold : fold + 1])

    def equations(self, weights: Weights, penalty: Penalty | None) -> tuple[Array, Array]:
        """H (d·m, d·m) and g (d·m,) of min ½ kᵀHk + gᵀk."""
        d, m = len(self.exponents), self.m
        h, g = np.zeros((d * m, d * m)), np.zeros(d * m)
        if self.shoe:
            arms = self.wide_arms
            h += sum(each.gram for each in self.shoe) * (arms.T @ (weights.shoe[:, None] * arms))
            g -= sum(np.einsum("c,cj,cj->j", weights.shoe, arms, each.against) for each in self.shoe)
        blocks = np.zeros((m, d, d))
        for each in self.chamber:
            blocks += weights.chamber[:, None, None] * each.gram
            g -= (weights.chamber[:, None] * each.against).T.ravel()
        if penalty is not None:
            blocks += penalty.blocks
            g -= np.einsum("mij,mj->im", penalty.blocks, penalty.target).ravel()
        taxel = np.arange(m)
        for i in range(d):
            for j in range(d):
                h[i * m + taxel, j * m + taxel] += blocks[:, i, j]
        return h, g

    def residual_squares(self, k: Array) -> tuple[Array, Array]:
        """(3,) of the shoe's channels and (m,) of the taxels in the chamber: sums of squared residuals."""
        arms = self.wide_arms
        shoe = sum((each.residual_squares(k, arms) for each in self.shoe), np.zeros(3))
        return shoe, sum((each.residual_squares(k) for each in self.chamber), np.zeros(self.m))

    @property
    def n_shoe(self) -> int:
        """Samples of the shoe."""
        return sum(each.n for each in self.shoe)

    @property
    def n_chamber(self) -> Array:
        """(m,) samples in the chamber."""
        return sum((each.n for each in self.chamber), np.zeros(self.m))

    def limits(self, common: Array, end_count: float, steepest: float) -> Constraints:
        """No slope below 0, none above `steepest` times the most of the curve `common` (d,), up to `end_count`."""
        d, m = len(self.exponents), self.m
        x = np.linspace(0.0, end_count / self.scale_count, _GRID)
        slopes = np.stack([p * x ** max(p - 1, 0) for p in self.exponents])  # (d, grid)
        rows = np.zeros((m, _GRID, d, m))
        taxel = np.arange(m)
        rows[taxel, :, :, taxel] = slopes.T
        most = max(float((common @ slopes).max()), 1e-6) * steepest
        return Constraints(rows.reshape(m * _GRID, d * m), np.zeros(m * _GRID), np.full(m * _GRID, most))


def fused_problem(
    samples: Sequence[Samples], slots: NDArray[np.intp], exponents: tuple[int, ...], scale_count: float,
    rest_count: Array | None = None,
) -> FusedProblem:  # fmt: skip
    """Of the taxels `slots` (m,); `rest_count` (slots,): counts below that, instead of below each trial's own rest."""
    layout = samples[0].trial.layout
    x, y = layout.xy_m.reshape(-1, 2)[slots].T
    arms = layout.taxel_area_m2 * np.stack([np.ones_like(x), y, -x])
    shoe: list[ShoeSums | None] = [None] * FOLDS
    chamber: list[ChamberSums | None] = [None] * FOLDS
    for each in samples:
        own = each.activation if rest_count is None else each.activation + (rest_count - each.trial.rest_count)
        scaled = own[:, slots] / scale_count
        valid = each.valid[:, slots]
        if each.trial.kind == "shoe":
            whole = valid.all(axis=1)
            scaled, wrench = scaled[whole], each.reference[whole]
            drift = Drift.of(each.t_s[whole], scaled, wrench, exponents) if rest_count is None else None
        for fold, rows in enumerate(_parts(len(scaled))):
            if each.trial.kind == "chamber":
                sums = ChamberSums.of(scaled[rows], valid[rows], each.reference[rows, 0], exponents)
                chamber[fold] = sums if chamber[fold] is None else chamber[fold] + sums  # type: ignore[operator]
            else:
                own_drift = None if drift is None else drift.rows(rows)
                part = ShoeSums.of(scaled[rows], wrench[rows], exponents, own_drift)
                shoe[fold] = part if shoe[fold] is None else shoe[fold] + part  # type: ignore[operator]
    return FusedProblem(
        exponents, scale_count, arms,
        tuple(s for s in shoe if s is not None), tuple(c for c in chamber if c is not None),
    )  # fmt: skip


def _parts(n: int) -> list[slice]:
    """FOLDS stretches, half a filter's frame apart from each other: no sample of one has part in another."""
    edges = np.linspace(0, n, FOLDS + 1).astype(int).tolist()
    apart = FRAME // 2 if n > 4 * FOLDS * FRAME else 0
    return [slice(a + (apart if a else 0), b) for a, b in pairwise(edges)]
