"""Choose the weights of the fused problem and solve it, as published or in the default way.

`fit_fused` chooses degree and penalty by cross-validation over blocks of time, iterates the weights until they agree
with the residuals, and bounds the slopes of the curves. Every curve is 0 without load. The penalty is not on the size
of the coefficients but on their distance from the curve common to all taxels, times the taxel's gain: the best
knowledge about a taxel that was hardly loaded.

`fit_as_published` is Sorrentino et al. 2020 unchanged: a cubic in raw counts with its constant, the published weights
and λ, and no constraints. Only the signs of the regressors are corrected.
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
STEEPEST = 5.0  # upper limit of a slope, times the steepest slope of the common curve
GAIN_SPREAD = 0.3  # prior standard deviation of the taxels' gains; published recordings have 0.15 to 0.25
_ROUNDS = 3  # iterations of the weights
_GAIN_ROUNDS = 4
_INITIAL_DEGREE, _INITIAL_PENALTY = 3, 1e-3  # for the weights by which all degrees and penalties are compared

PUBLISHED_SHOE = np.array([1.0, 33.0, 10.0])  # divided by the number of samples, as is the next one; N and N·m
PUBLISHED_CHAMBER = 1e-6  # Pa
PUBLISHED_PENALTY = 1e-9
PUBLISHED_EXPONENTS = (0, 1, 2, 3)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """The curves of m taxels: coefficients of the powers 0 to the degree of the activation in counts."""

    coefficients_pa: Array  # (m, k)
    covariance_pa2: Array  # (m, k, k)
    common_pa: Array  # (k,) the curve common to all taxels
    weights: Weights
    penalty: float
    tried: tuple[tuple[int, float, float], ...]  # degree, penalty and cross-validation error
    solution: Solution
    residual_pa: Array  # (m,) standard deviation in the chamber; NaN without chamber
    residual_wrench: Array  # (3,) of f_z (N), m_x, m_y (N·m); NaN without shoe

    @property
    def degree(self) -> int:
        """Return the degree of the polynomials."""
        return int(self.coefficients_pa.shape[1]) - 1


@dataclass(frozen=True, slots=True, eq=False)
class InitialFit:
    """A first fit, from which clocks and weights are estimated."""

    coefficients_pa: Array  # (m, k) from power 0 on
    arms: Array  # (3, m)


def first_fit(problem: FusedProblem) -> InitialFit:
    """Fit with the initial degree and penalty, without constraints."""
    of_initial_degree = problem.with_degree(_INITIAL_DEGREE)
    ones = Weights(np.ones(3), np.ones(problem.m))
    weights, common = _iterate_weights(of_initial_degree, ones, _INITIAL_PENALTY)
    k = solve(*of_initial_degree.equations(weights, _penalty(of_initial_degree, weights, _INITIAL_PENALTY, common))).k
    return InitialFit(_in_counts(of_initial_degree, k), problem.arms)


def fit_fused(
    problem: FusedProblem, n_correlated: Weights, end_count: float, progress: Progress = lambda text: None
) -> Fit:
    """Fit the curves of a problem with powers 1 to max(DEGREES); slopes are limited up to `end_count`.

    `n_correlated` (1 or more) is the number of samples of a channel that count as one, because residuals are not white.
    """
    of_initial_degree = problem.with_degree(_INITIAL_DEGREE)
    weights, _ = _iterate_weights(of_initial_degree, n_correlated, _INITIAL_PENALTY)
    errors: dict[tuple[int, float], Array] = {}
    for d in DEGREES:
        progress(f"cross-validation of degree {d}")
        errors |= {
            (d, trial_penalty): error
            for trial_penalty, error in zip(PENALTIES, _cv_errors(problem.with_degree(d), weights), strict=True)
        }
    degree, penalty = _choose(errors)
    tried = tuple((*choice, float(error.mean())) for choice, error in errors.items())
    chosen = problem.with_degree(degree)
    progress("weights")
    weights, common = _iterate_weights(chosen, n_correlated, penalty)
    hessian, gradient = chosen.equations(weights, _penalty(chosen, weights, penalty, common))
    progress(f"{len(gradient)} unknowns with their constraints")
    solution = solve(hessian, gradient, chosen.limits(common[0], end_count, STEEPEST))
    return _build_fit(chosen, solution, hessian, common[0], weights, penalty, tried)


def _choose(errors: dict[tuple[int, float], Array]) -> tuple[int, float]:
    """Choose the strongest penalty whose error is not significantly above the least, then the best degree for it.

    Significance is the standard error of the difference over the folds. The degree is chosen by its error alone,
    because a high degree costs little while all taxels share the curve.
    """
    best = min(errors.values(), key=np.mean)

    def is_as_good(error: Array) -> bool:
        difference = error - best
        return bool(difference.mean() <= difference.std(ddof=1) / FOLDS**0.5)

    penalty = max(penalty for (_, penalty), error in errors.items() if is_as_good(error))
    return min((choice for choice in errors if choice[1] == penalty), key=lambda choice: float(errors[choice].mean()))


def fit_as_published(problem: FusedProblem, rest_count: Array) -> Fit:
    """Fit the curves of a problem with powers 0 to 3 of counts below `rest_count` (m,), the same in all its samples.

    A cubic in raw counts C is one in rest − C with other coefficients, a = T k; the penalty is λ‖a‖².
    """
    shoe = PUBLISHED_SHOE / max(problem.n_shoe, 1)
    weights = Weights(shoe, PUBLISHED_CHAMBER / np.maximum(problem.n_chamber, 1.0))
    d = len(problem.exponents)
    to_raw = np.zeros((problem.m, d, d))
    for k in range(d):
        for j in range(k + 1):  # (rest − C)^k = Σ_j (k over j) rest^(k−j) (−C)^j
            to_raw[:, j, k] = comb(k, j) * (-1.0) ** j * rest_count ** (k - j) / problem.scale_count**k
    blocks = PUBLISHED_PENALTY * to_raw.transpose(0, 2, 1) @ to_raw
    hessian, gradient = problem.equations(weights, Penalty(blocks, np.zeros((problem.m, d))))
    solution = solve(hessian, gradient)
    return _build_fit(problem, solution, hessian, np.zeros(d), weights, PUBLISHED_PENALTY, ())


def _iterate_weights(
    problem: FusedProblem, n_correlated: Weights, penalty: float
) -> tuple[Weights, tuple[Array, Array]]:
    """Iterate until weights and residuals agree; return the weights, and the common curve with its gains."""
    n_shoe, n_chamber = max(problem.n_shoe, 1), np.maximum(problem.n_chamber, 1.0)
    shoe = sum((sums.squares for sums in problem.shoe), np.zeros(3)) / n_shoe
    chamber = sum((sums.squares for sums in problem.chamber), np.zeros(problem.m)) / n_chamber
    weights = _weights(shoe, chamber, n_correlated)
    for _ in range(_ROUNDS):
        common = common_curve(problem, weights)
        k = solve(*problem.equations(weights, _penalty(problem, weights, penalty, common))).k
        shoe_squares, chamber_squares = problem.residual_squares(k)
        weights = _weights(shoe_squares / n_shoe, chamber_squares / n_chamber, n_correlated)
    return weights, common_curve(problem, weights)


def _weights(shoe: Array, chamber: Array, n_correlated: Weights) -> Weights:
    """Return the inverse of the variances times `n_correlated`; 0 where a variance is 0, since there are no data."""

    def inverse(variance: Array, factor: Array) -> Array:
        floor = 1e-6 * float(variance.max(initial=0.0))
        return np.where(variance > 0, 1.0 / np.maximum(variance * factor, max(floor, 1e-30)), 0.0)

    return Weights(inverse(shoe, n_correlated.shoe), inverse(chamber, n_correlated.chamber))


def common_curve(problem: FusedProblem, weights: Weights) -> tuple[Array, Array]:
    """Return (d,) the curve common to all taxels and (m,) the gain of each, 1 on average.

    Solves k_i = g_i·c alternately for c and g. Without gains, the more sensitive taxels would bend the curve, because
    they read more at the same load. Gains have a prior of 1 ± GAIN_SPREAD.
    """
    hessian, gradient = problem.equations(weights, None)
    d, m = len(problem.exponents), problem.m
    h, g = hessian.reshape(d, m, d, m), gradient.reshape(d, m)
    gain = np.ones(m)
    for _ in range(_GAIN_ROUNDS):
        curve_hessian = np.einsum("imjn,m,n->ij", h, gain, gain, optimize=True)
        curve = solve(curve_hessian + 1e-12 * np.diag(np.diag(curve_hessian)), g @ gain).k
        gain_hessian = np.einsum("imjn,i,j->mn", h, curve, curve, optimize=True) + np.eye(m) / GAIN_SPREAD**2
        gain = solve(gain_hessian, g.T @ curve - 1.0 / GAIN_SPREAD**2).k
        mean = float(gain.mean())
        gain, curve = gain / mean, curve * mean
    return curve, gain


def _penalty(problem: FusedProblem, weights: Weights, penalty: float, common: tuple[Array, Array]) -> Penalty:
    """Return the penalty relative to the data's average information on a coefficient, so that it is free of units."""
    scale = _coefficient_scales(problem, problem.equations(weights, None)[0])
    return Penalty(np.tile(np.diag(penalty * scale), (problem.m, 1, 1)), _targets(*common))


def _targets(curve: Array, gain: Array) -> Array:
    """Return (m, d) the coefficients towards which the penalty pulls."""
    return gain[:, None] * curve


def _coefficient_scales(problem: FusedProblem, hessian: Array) -> Array:
    """Return (d,) the data's information on a coefficient of each power, averaged over the taxels."""
    scales: Array = np.diag(hessian).reshape(len(problem.exponents), -1).mean(axis=1)
    return scales


def _cv_errors(problem: FusedProblem, weights: Weights) -> Array:
    """Return (penalties, FOLDS) mean squared residuals of the held-out fold, relative to their expected variance.

    One eigendecomposition of the equations serves all penalties.
    """
    errors = np.zeros((len(PENALTIES), FOLDS))
    for fold in range(FOLDS):
        training, held_out = problem.without(fold), problem.only(fold)
        hessian, gradient = training.equations(weights, None)
        scale = np.repeat(np.sqrt(_coefficient_scales(training, hessian)), training.m)
        target = _targets(*common_curve(training, weights)).T.ravel() * scale
        values, vectors = np.linalg.eigh(hessian / scale / scale[:, None])
        data, prior = -(gradient / scale) @ vectors, target @ vectors
        n = 3 * held_out.n_shoe + float(held_out.n_chamber.sum())
        for row, penalty in enumerate(PENALTIES):
            k = vectors @ ((data + penalty * prior) / (np.maximum(values, 0.0) + penalty)) / scale
            shoe, chamber = held_out.residual_squares(k)
            errors[row, fold] = (float(shoe @ weights.shoe) + float(chamber @ weights.chamber)) / max(n, 1.0)
    return errors


def _build_fit(
    problem: FusedProblem, solution: Solution, hessian: Array, common: Array, weights: Weights, penalty: float,
    tried: tuple[tuple[int, float, float], ...],
) -> Fit:  # fmt: skip
    """Convert a solution to coefficients in counts, with their covariance and the residuals."""
    d, m = len(problem.exponents), problem.m
    to_counts = problem.scale_count ** -np.array(problem.exponents, float)
    columns = np.array(problem.exponents)
    inverse = np.linalg.inv(hessian).reshape(d, m, d, m)
    taxel = np.arange(m)
    blocks = inverse[:, taxel, :, taxel] * to_counts[:, None] * to_counts
    width = max(problem.exponents) + 1
    coefficients, covariance = _in_counts(problem, solution.k), np.zeros((m, width, width))
    covariance[:, columns[:, None], columns] = blocks
    common_pa = np.zeros(width)
    common_pa[columns] = common * to_counts
    if not np.isfinite(coefficients).all():
        raise CalibrationError("the curves are not finite: the recordings contradict each other")
    shoe, chamber = problem.residual_squares(solution.k)
    with np.errstate(divide="ignore", invalid="ignore"):
        residual_pa = np.sqrt(chamber / problem.n_chamber)
        residual_wrench = np.sqrt(shoe / problem.n_shoe) if problem.n_shoe else np.full(3, np.nan)
    return Fit(coefficients, covariance, common_pa, weights, penalty, tried, solution, residual_pa, residual_wrench)


def _in_counts(problem: FusedProblem, k: Array) -> Array:
    """Return (m, width) the coefficients of the powers of the activation in counts, from power 0 on."""
    coefficients = np.zeros((problem.m, max(problem.exponents) + 1))
    to_counts = problem.scale_count ** -np.array(problem.exponents, float)
    coefficients[:, problem.exponents] = k.reshape(len(to_counts), -1).T * to_counts
    return coefficients
