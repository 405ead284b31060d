"""The sums are compared with computations on the samples."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from insole_daemon.calibration.problem import FusedProblem, Penalty, Weights
from insole_daemon.calibration.statistics import ChamberSums, Drift, ShoeSums, powers

M, EXPONENTS = 6, (1, 2, 3)
RNG = np.random.default_rng(0)
X = RNG.uniform(0, 1.2, (500, M))
WRENCH = RNG.standard_normal((500, 3))
VALID = RNG.random((500, M)) < 0.8
PRESSURE = RNG.uniform(0, 9e4, 500)
ARMS = RNG.standard_normal((3, M))
K = RNG.standard_normal(3 * M)
WEIGHTS = Weights(np.array([1.0, 33.0, 10.0]), RNG.uniform(1e-6, 2e-6, M))


def designs() -> list[np.ndarray]:
    """Return the regressors as in the paper: (rows, 3·M) of f_z, m_x, m_y."""
    phi = powers(X, EXPONENTS)
    return [phi * np.tile(arm, 3) for arm in ARMS]


def whole() -> FusedProblem:
    parts = [slice(0, 200), slice(200, 500)]
    return FusedProblem(
        EXPONENTS, 40.0, ARMS,
        tuple(ShoeSums.of(X[p], WRENCH[p], EXPONENTS) for p in parts),
        tuple(ChamberSums.of(X[p], VALID[p], PRESSURE[p], EXPONENTS) for p in parts),
    )  # fmt: skip


def test_powers_are_ordered_power_by_power() -> None:
    rows = powers(X, EXPONENTS)
    assert np.array_equal(rows[:, :M], X)
    assert np.array_equal(rows[:, 2 * M], X[:, 0] ** 3)


def test_equations_equal_stacked_least_squares() -> None:
    h, g = np.zeros((3 * M, 3 * M)), np.zeros(3 * M)
    for weight, phi, b in zip(WEIGHTS.shoe, designs(), WRENCH.T, strict=True):
        h += weight * phi.T @ phi
        g -= weight * phi.T @ b
    for i in range(M):
        phi = np.zeros((VALID[:, i].sum(), 3 * M))
        phi[:, i::M] = X[VALID[:, i], i, None] ** EXPONENTS
        h += WEIGHTS.chamber[i] * phi.T @ phi
        g -= WEIGHTS.chamber[i] * phi.T @ PRESSURE[VALID[:, i]]
    target = RNG.standard_normal((M, 3))
    blocks = np.tile(np.diag([2.0, 3.0, 4.0]), (M, 1, 1))
    h += np.diag(np.repeat([2.0, 3.0, 4.0], M))
    g -= np.repeat([2.0, 3.0, 4.0], M) * target.T.ravel()
    equations = whole().equations(WEIGHTS, Penalty(blocks, target))
    assert np.allclose(equations[0], h)
    assert np.allclose(equations[1], g)


def test_residuals_are_computed_from_the_sums() -> None:
    shoe, chamber = whole().residual_squares(K)
    expected = [((phi @ K - b) ** 2).sum() for phi, b in zip(designs(), WRENCH.T, strict=True)]
    assert np.allclose(shoe, expected)
    by_power = K.reshape(3, M)
    at = np.stack([sum(by_power[j, i] * X[:, i] ** (j + 1) for j in range(3)) for i in range(M)], axis=1)
    assert np.allclose(chamber, np.where(VALID, at - PRESSURE[:, None], 0.0).__pow__(2).sum(axis=0))


def test_a_slow_drift_does_not_change_the_fit() -> None:
    t_s = np.linspace(0, 60, 500)
    drifting = WRENCH + np.array([10.0, 0.2, 1.0]) + np.outer(t_s, [0.3, 0.01, -0.05])
    plain, drifted = (
        ShoeSums.of(X, wrench, EXPONENTS, Drift.of(t_s, X, wrench, EXPONENTS)) for wrench in (WRENCH, drifting)
    )
    assert np.allclose(plain.gram, drifted.gram)
    assert np.allclose(plain.cross, drifted.cross)
    assert np.allclose(plain.squares, drifted.squares)
    line = np.stack([np.ones_like(t_s), t_s], axis=1)
    phi = powers(X, EXPONENTS)
    left = phi - line @ np.linalg.lstsq(line, phi, rcond=None)[0]
    assert np.allclose(plain.gram, left.T @ left)


def test_drift_is_estimated_over_the_whole_trial() -> None:
    t_s = np.linspace(0, 60, 500)
    drift = Drift.of(t_s, X, WRENCH, EXPONENTS)
    whole = ShoeSums.of(X, WRENCH, EXPONENTS, drift)
    parts = [slice(0, 200), slice(200, 500)]
    added = sum_of(ShoeSums.of(X[p], WRENCH[p], EXPONENTS, drift.rows(p)) for p in parts)
    assert np.allclose(added.gram, whole.gram)
    assert np.allclose(added.cross, whole.cross)


def sum_of(parts: Iterable[ShoeSums]) -> ShoeSums:
    first, second = parts
    return first + second


def test_lower_degrees_use_the_same_sums() -> None:
    lower = whole().with_degree(2)
    alone = ShoeSums.of(X, WRENCH, EXPONENTS[:2])
    assert np.allclose(sum((sums.gram for sums in lower.shoe), np.zeros((2 * M, 2 * M))), alone.gram)
    assert np.allclose(lower.chamber[0].gram, ChamberSums.of(X[:200], VALID[:200], PRESSURE[:200], EXPONENTS[:2]).gram)


def test_limits_are_the_slopes_of_the_curves() -> None:
    limits = whole().limits(np.array([8e3, 10.0, 1.0]), 60.0, 5.0)
    grid = np.linspace(0, 1.5, len(limits.rows) // M)
    slope = limits.rows @ K
    by_power = K.reshape(3, M)
    for i in range(M):
        expected = by_power[0, i] + 2 * by_power[1, i] * grid + 3 * by_power[2, i] * grid**2
        assert np.allclose(slope.reshape(M, -1)[i], expected)
    assert limits.low.max() == 0.0
    assert limits.high[0] > 5 * 8e3
