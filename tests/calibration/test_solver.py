"""The quadratic programme: constraints and optimality conditions hold, and another solver agrees."""

from __future__ import annotations

import clarabel
import numpy as np
import pytest
from scipy import sparse

from insole_daemon.calibration.solver import KKT_LIMIT, Constraints, kkt_residual, solve
from insole_daemon.errors import CalibrationError


def programme(n: int = 40) -> tuple[np.ndarray, np.ndarray, Constraints]:
    """Return a programme with columns of very different size, as powers of counts have, and active constraints."""
    rng = np.random.default_rng(3)
    size = 10.0 ** rng.uniform(-5, 5, n)
    phi = rng.standard_normal((200, n)) * size
    k = rng.standard_normal(n) / size
    rows = np.diag(size)
    return phi.T @ phi, -phi.T @ (phi @ k), Constraints(rows, np.zeros(n), np.full(n, 1.0))


def test_without_constraints_it_is_least_squares() -> None:
    h, g, _ = programme()
    solution = solve(h, g)
    assert np.allclose(h @ solution.k, -g, rtol=1e-8, atol=1e-9 * np.abs(g).max())
    assert solution.active == 0


def test_constraints_hold_and_another_solver_finds_the_same() -> None:
    h, g, limits = programme()
    solution = solve(h, g, limits)
    assert solution.kkt <= KKT_LIMIT
    assert solution.active > 5
    at = limits.rows @ solution.k
    assert at.min() > -1e-9
    assert at.max() < 1 + 1e-9
    n = len(g)
    size = np.diag(limits.rows)  # clarabel is handed the same problem in columns of one size
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    scaled, limits_of = np.triu(h / size / size[:, None]), np.vstack([-np.eye(n), np.eye(n)])
    other = clarabel.DefaultSolver(
        sparse.csc_matrix(scaled), g / size, sparse.csc_matrix(limits_of),
        np.concatenate([np.zeros(n), np.ones(n)]), [clarabel.NonnegativeConeT(2 * n)], settings,
    ).solve()  # fmt: skip
    assert np.allclose(at, np.array(other.x), atol=1e-5)


def test_the_kkt_residual_detects_a_wrong_solution() -> None:
    h, g = np.eye(2), np.array([-1.0, 1.0])
    rows, low, high = np.eye(2), np.zeros(2), np.full(2, np.inf)
    right = np.array([1.0, 0.0])
    assert kkt_residual(h, g, rows, low, high, right, np.array([0.0, -1.0])) < 1e-12
    assert kkt_residual(h, g, rows, low, high, right, np.zeros(2)) == pytest.approx(1.0), "stationarity"
    assert kkt_residual(h, g, rows, low, high, np.array([1.0, -1.0]), np.zeros(2)) == pytest.approx(1.0), "feasibility"
    assert kkt_residual(h, g, rows, low, high, right, np.array([-1.0, -1.0])) >= 1.0, "complementarity"


def test_an_undetermined_problem_is_refused() -> None:
    h = np.ones((3, 3))
    with pytest.raises(CalibrationError, match="do not determine the curves"):
        solve(h - 1e-3 * np.eye(3), np.ones(3))
