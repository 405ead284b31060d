"""Solve the calibration's quadratic programme: min ½ kᵀHk + gᵀk, with low ≤ Gk ≤ high if there are constraints.

Columns are scaled to one size first, which improves the arithmetic and does not change the solution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from ..recording.lab import need

Array = NDArray[np.float64]

KKT_LIMIT = 1e-6
_NO_LIMIT = 1e30  # the solver treats this as infinite


@dataclass(frozen=True, slots=True, eq=False)
class Constraints:
    """Constraints low ≤ rows · k ≤ high."""

    rows: Array  # (c, n)
    low: Array  # (c,)
    high: Array  # (c,)


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Solution of a programme; `kkt` is the largest residual of the optimality conditions, for scaled columns."""

    k: Array  # (n,)
    kkt: float
    active: int  # number of active constraints


def solve(hessian: Array, gradient: Array, constraints: Constraints | None = None) -> Solution:
    """Return the minimiser k (n,) for a symmetric, positive definite hessian (n, n) and a gradient (n,).

    Raises CalibrationError if there is no unique solution.
    """
    scale = 1.0 / np.sqrt(np.maximum(np.diag(hessian), np.finfo(float).tiny))
    h, g = hessian * scale * scale[:, None], gradient * scale
    unit = max(float(np.abs(g).max()), np.finfo(float).tiny)
    g = g / unit  # z is k in this unit
    if constraints is None:
        z = _solve_cholesky(h, g)
        return Solution(z * scale * unit, float(np.abs(h @ z + g).max()), 0)
    rows = constraints.rows * scale
    lengths = np.maximum(np.linalg.norm(rows, axis=1), np.finfo(float).tiny)
    rows = rows / lengths[:, None]
    low, high = constraints.low / lengths / unit, constraints.high / lengths / unit
    z, lower, upper = _solve_constrained(h, g, rows, low, high)
    kkt = kkt_residual(h, g, rows, low, high, z, upper - lower)
    if not kkt <= KKT_LIMIT:
        raise CalibrationError(
            f"the solver ended with a KKT residual of {kkt:.1e}, expected at most {KKT_LIMIT:.0e}: the recordings "
            "leave the curves undetermined; add a chamber trial, or slow movements that load the whole sole"
        )
    return Solution(z * scale * unit, kkt, int(np.count_nonzero((lower > 1e-7) | (upper > 1e-7))))


def _solve_cholesky(h: Array, g: Array) -> Array:
    """Solve hz = −g; CalibrationError if h is singular."""
    linalg = need("scipy.linalg", "scipy", "a calibration")
    try:
        z: Array = linalg.cho_solve(linalg.cho_factor(h, check_finite=False), -g, check_finite=False)
    except linalg.LinAlgError as error:
        raise CalibrationError(
            "the recordings do not determine the curves: the equations are singular; add a chamber trial, or slow "
            "movements that load the whole sole"
        ) from error
    return z


def _solve_constrained(h: Array, g: Array, rows: Array, low: Array, high: Array) -> tuple[Array, Array, Array]:
    """Return the solution, and the multipliers of the lower and of the upper limits."""
    piqp = need("piqp", "piqp", "a calibration with constraints")
    solver = piqp.DenseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = 1e-10
    solver.settings.check_duality_gap = True
    solver.settings.eps_duality_gap_abs = solver.settings.eps_duality_gap_rel = 1e-9
    solver.setup(
        np.asfortranarray(h), g, G=np.asfortranarray(rows),
        h_l=np.maximum(low, -_NO_LIMIT), h_u=np.minimum(high, _NO_LIMIT),
    )  # fmt: skip
    solver.solve()  # the caller checks the KKT residual instead of the solver's status
    result = solver.result
    return np.array(result.x), np.array(result.z_l), np.array(result.z_u)


def kkt_residual(h: Array, g: Array, rows: Array, low: Array, high: Array, z: Array, multipliers: Array) -> float:
    """Return the largest violation of stationarity, feasibility and complementarity.

    `multipliers` (c,) are negative for lower limits.
    """
    values = rows @ z
    above, below = np.maximum(multipliers, 0.0), np.maximum(-multipliers, 0.0)
    return float(
        max(
            np.abs(h @ z + g + rows.T @ multipliers).max(),
            np.maximum(low - values, values - high).max(initial=0.0),
            _slack(above, high - values).max(initial=0.0),
            _slack(below, values - low).max(initial=0.0),
        )
    )


def _slack(multiplier: Array, distance: Array) -> Array:
    """Return |multiplier · distance|, 0 for an infinite limit."""
    return np.abs(multiplier * np.where(np.isfinite(distance), distance, 0.0))
