"""How the fused problem is weighted and solved: as published, or with what its conclusion asks for.

`fit_fused` chooses the degree and the penalty by cross-validation over blocks of time, takes the weights from the
residuals until they agree (iteratively re-weighted), and bounds the curves. Every curve is 0 at rest. What is penalised
is not the size of the coefficients but their distance from the curve that all taxels have in common, times the taxel's
gain: that is what is known of a taxel that was hardly loaded.

`fit_as_published` is Sorrentino et al. 2020 to the letter: a cubic in raw counts with its constant, its weights and its
λ. It has no constraints. Only the signs of its regressors are corrected.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from .problem import FOLDS, FusedProblem, Penalty, Weights
from .solver import Solution, solve

Array = NDArray[np.float64]
Progress = Callable[[str], None]

DEGREES = (1, 2, 3)
PENALTIES = (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
STEEPEST = 5.0  # times the steepest slope of the common curve
GAIN_SPREAD = 0.3  # of the taxels' gains, where they are not known; published recordings have 0.15 to 0.25
_ROUNDS = 3  # of re-weighting
_TURNS = 4
_TRIED_DEGREE, _TRIED_PENALTY = 3, 1e-3  # with which weights are found to compare the others by

PUBLISHED_SHOE = np.array([1.0, 33.0, 10.0])  # over the number of samples, as the next one; N and N·m
PUBLISHED_CHAMBER = 1e-6  # Pa
PUBLISHED_PENALTY = 1e-9
PUBLISHED_EXPONENTS = (0, 1, 2, 3)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """The curves of m taxels: powers of the activation in counts, from 0 to the degree."""

    coefficients_pa: Array  # (m, k)
    covariance_pa2: Array  # (m, k, k)
    common_pa: Array  # (k,) the curve that all have in common
    weights: Weights
    penalty: float
    tried: tuple[tuple[int, float, float], ...]  # degree, penalty, and the error of what was held out
    solution: Solution
    residual_pa: Array  # (m,) standard deviation in the chamber; NaN without one
    residual_wrench: Array  # (3,) of f_z (N), m_x, m_y (N·m); NaN without a shoe

    @property
    def degree(self) -> int:
        """Of the polynomials."""
        return int(self.coefficients_pa.shape[1]) - 1


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """A first fit, by which clocks and weights are found."""

    coefficients_pa: Array  # (m, k) from power 0 on
    arms: Array  # (3, m)


def first_fit(problem: FusedProblem) -> Start:
    """Of the usual degree, without a choice and without limits."""
    start = problem.lower(_TRIED_DEGREE)
    ones = Weights(np.ones(3), np.ones(problem.m))
    weights, common = _reweighted(start, ones, _TRIED_PENALTY)
    k = solve(*start.equations(weights, _penalty(start, weights, _TRIED_PENALTY, common))).k
    return Start(_in_counts(start, k), problem.arms)


def fit_fused(problem: FusedProblem, alike: Weights, end_count: float, progress: Progress = lambda text: None) -> Fit:
    """The curves of a problem with powers 1 to max(DEGREES); slopes are limited up to `end_count`.

    `alike` (of ones and more): how many samples of a channel say the same, since what is left is not white.
    """
    start = problem.lower(_TRIED_DEGREE)
    weights, _ = _reweighted(start, alike, _TRIED_PENALTY)
    errors: dict[tuple[int, float], Array] = {}
    for d in DEGREES:
        progress(f"cross-validation of degree {d}")
        errors |= {(d, p): error for p, error in zip(PENALTIES, _held_out(problem.lower(d), weights), strict=True)}
    degree, penalty = _chosen(errors)
    tried = tuple((*choice, float(error.mean())) for choice, error in errors.items())
    chosen = problem.lower(degree)
    progress("weights")
    weights, common = _reweighted(chosen, alike, penalty)
    hessian, gradient = chosen.equations(weights, _penalty(chosen, weights, penalty, common))
    progress(f"{len(gradient)} unknowns with their constraints")
    solution = solve(hessian, gradient, chosen.limits(common[0], end_count, STEEPEST))
    return _fit(chosen, solution, hessian, common[0], weights, penalty, tried)


def _chosen(errors: dict[tuple[int, float], Array]) -> tuple[int, float]:
    """The strongest penalty that is as good as the best choice, within what that one's lead varies by over the folds.

    Of one penalty, the degree with the least error: a high one costs little while all taxels share the curve.
    """
    best = min(errors.values(), key=np.mean)

    def as_good(error: Array) -> bool:
        behind = error - best
        return bool(behind.mean() <= behind.std(ddof=1) / FOLDS**0.5)

    penalty = max(penalty for (_, penalty), error in errors.items() if as_good(error))
    return min((choice for choice in errors if choice[1] == penalty), key=lambda choice: float(errors[choice].mean()))


def fit_as_published(problem: FusedProblem, rest_count: Array) -> Fit:
    """The curves of a problem with powers 0 to 3 of counts below `rest_count` (m,), the same for all its samples.

    A cubic in raw counts C is one in rest − C with other coefficients, a = T k; the penalty is λ‖a‖².
    """
    shoe = PUBLISHED_SHOE / max(problem.n_shoe, 1)
    weights = Weights(shoe, PUBLISHED_CHAMBER / np.maximum(problem.n_chamber, 1.0))
    d = len(problem.exponents)
    turn = np.zeros((problem.m, d, d))
    for k in range(d):
        for j in range(k + 1):  # (rest − C)^k = Σ_j (k over j) rest^(k−j) (−C)^j
            turn[:, j, k] = comb(k, j) * (-1.0) ** j * rest_count ** (k - j) / problem.scale_count**k
    blocks = PUBLISHED_PENALTY * turn.transpose(0, 2, 1) @ turn
    hessian, gradient = problem.equations(weights, Penalty(blocks, np.zeros((problem.m, d))))
    solution = solve(hessian, gradient)
    return _fit(problem, solution, hessian, np.zeros(d), weights, PUBLISHED_PENALTY, ())


def _reweighted(problem: FusedProblem, alike: Weights, penalty: float) -> tuple[Weights, tuple[Array, Array]]:
    """The weights at which residuals and weights agree, and the common curve with its gains."""
    n_shoe, n_chamber = max(problem.n_shoe, 1), np.maximum(problem.n_chamber, 1.0)
    shoe = sum((each.squares for each in problem.shoe), np.zeros(3)) / n_shoe
    chamber = sum((each.squares for each in problem.chamber), np.zeros(problem.m)) / n_chamber
    weights = _weights(shoe, chamber, alike)
    for _ in range(_ROUNDS):
        common = common_curve(problem, weights)
        k = solve(*problem.equations(weights, _penalty(problem, weights, penalty, common))).k
        left_shoe, left_chamber = problem.residual_squares(k)
        weights = _weights(left_shoe / n_shoe, left_chamber / n_chamber, alike)
    return weights, common_curve(problem, weights)


def _weights(shoe: Array, chamber: Array, alike: Weights) -> Weights:
    """Of variances; one that is 0 has no data."""

    def inverse(variance: Array, times: Array) -> Array:
        floor = 1e-6 * float(variance.max(initial=0.0))
        return np.where(variance > 0, 1.0 / np.maximum(variance * times, max(floor, 1e-30)), 0.0)

    return Weights(inverse(shoe, alike.shoe), inverse(chamber, alike.chamber))


def common_curve(problem: FusedProblem, weights: Weights) -> tuple[Array, Array]:
    """(d,) the curve that all taxels have in common, and (m,) by what each is to be multiplied, 1 on average.

    k_i = g_i·c, by turns for c and for g. Without gains the more sensitive taxels, which say more at the same load,
    would bend the curve. Gains differ from 1 by GAIN_SPREAD unless the data know better.
    """
    hessian, gradient = problem.equations(weights, None)
    d, m = len(problem.exponents), problem.m
    h, g = hessian.reshape(d, m, d, m), gradient.reshape(d, m)
    gain = np.ones(m)
    for _ in range(_TURNS):
        of_curve = np.einsum("imjn,m,n->ij", h, gain, gain, optimize=True)
        curve = solve(of_curve + 1e-12 * np.diag(np.diag(of_curve)), g @ gain).k
        of_gain = np.einsum("imjn,i,j->mn", h, curve, curve, optimize=True) + np.eye(m) / GAIN_SPREAD**2
        gain = solve(of_gain, g.T @ curve - 1.0 / GAIN_SPREAD**2).k
        mean = float(gain.mean())
        gain, curve = gain / mean, curve * mean
    return curve, gain


def _penalty(problem: FusedProblem, weights: Weights, penalty: float, common: tuple[Array, Array]) -> Penalty:
    """In terms of what the data say of a coefficient on average: `penalty` means the same in any unit."""
    size = _sizes(problem, problem.equations(weights, None)[0])
    return Penalty(np.tile(np.diag(penalty * size), (problem.m, 1, 1)), _targets(*common))


def _targets(curve: Array, gain: Array) -> Array:
    """(m, d)."""
    return gain[:, None] * curve


def _sizes(problem: FusedProblem, hessian: Array) -> Array:
    """(d,) what the data say of a coefficient of each power, on average over the taxels."""
    sizes: Array = np.diag(hessian).reshape(len(problem.exponents), -1).mean(axis=1)
    return sizes


def _held_out(problem: FusedProblem, weights: Weights) -> Array:
    """(penalties, FOLDS) mean squared residual of a part that was not fitted, in terms of its expected variance.

    One decomposition of the equations serves all penalties.
    """
    errors = np.zeros((len(PENALTIES), FOLDS))
    for fold in range(FOLDS):
        rest, part = problem.without(fold), problem.only(fold)
        hessian, gradient = rest.equations(weights, None)
        size = np.repeat(np.sqrt(_sizes(rest, hessian)), rest.m)
        target = _targets(*common_curve(rest, weights)).T.ravel() * size
        values, vectors = np.linalg.eigh(hessian / size / size[:, None])
        data, prior = -(gradient / size) @ vectors, target @ vectors
        n = 3 * part.n_shoe + float(part.n_chamber.sum())
        for at, penalty in enumerate(PENALTIES):
            k = vectors @ ((data + penalty * prior) / (np.maximum(values, 0.0) + penalty)) / size
            shoe, chamber = part.residual_squares(k)
            errors[at, fold] = (float(shoe @ weights.shoe) + float(chamber @ weights.chamber)) / max(n, 1.0)
    return errors


def _fit(
    problem: FusedProblem, solution: Solution, hessian: Array, common: Array, weights: Weights, penalty: float,
    tried: tuple[tuple[int, float, float], ...],
) -> Fit:  # fmt: skip
    d, m = len(problem.exponents), problem.m
    size = problem.scale_count ** -np.array(problem.exponents, float)
    at = np.array(problem.exponents)
    inverse = np.linalg.inv(hessian).reshape(d, m, d, m)
    taxel = np.arange(m)
    blocks = inverse[:, taxel, :, taxel] * size[:, None] * size
    width = max(problem.exponents) + 1
    coefficients, covariance = _in_counts(problem, solution.k), np.zeros((m, width, width))
    covariance[:, at[:, None], at] = blocks
    whole = np.zeros(width)
    whole[at] = common * size
    if not np.isfinite(coefficients).all():
        raise CalibrationError("the curves came out as no numbers: the recordings contradict themselves")
    shoe, chamber = problem.residual_squares(solution.k)
    with np.errstate(divide="ignore", invalid="ignore"):
        residual_pa = np.sqrt(chamber / problem.n_chamber)
        residual_wrench = np.sqrt(shoe / problem.n_shoe) if problem.n_shoe else np.full(3, np.nan)
    return Fit(coefficients, covariance, whole, weights, penalty, tried, solution, residual_pa, residual_wrench)


def _in_counts(problem: FusedProblem, k: Array) -> Array:
    """(m, width) coefficients of the powers of the activation in counts, from 0 on."""
    coefficients = np.zeros((problem.m, max(problem.exponents) + 1))
    size = problem.scale_count ** -np.array(problem.exponents, float)
    coefficients[:, problem.exponents] = k.reshape(len(size), -1).T * size
    return coefficients
