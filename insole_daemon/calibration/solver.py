"""The calibration's quadratic programme: min ½ kᵀHk + gᵀk, and low ≤ Gk ≤ high where there are constraints.

Columns are brought to one size before it is solved, which changes nothing but the arithmetic.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from ..recording.lab import need

Array = NDArray[np.float64]

KKT_LIMIT = 1e-6
_NO_LIMIT = 1e30  # what the solver takes for infinite


@dataclass(frozen=True, slots=True, eq=False)
class Constraints:
    """low ≤ rows · k ≤ high."""

    rows: Array  # (c, n)
    low: Array  # (c,)
    high: Array  # (c,)


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Of a programme; `kkt` is the largest residual of its optimality conditions, in columns of one size."""

    k: Array  # (n,)
    kkt: float
    active: int  # constraints that hold the solution back


def solve(hessian: Array, gradient: Array, constraints: Constraints | None = None) -> Solution:
    """The k (n,) of a symmetric, positive definite hessian (n, n) and gradient (n,).

    CalibrationError where that has no solution.
    """
    scale = 1.0 / np.sqrt(np.maximum(np.diag(hessian), np.finfo(float).tiny))
    h, g = hessian * scale * scale[:, None], gradient * scale
    size = max(float(np.abs(g).max()), np.finfo(float).tiny)
    g = g / size  # k in units of `size`
    if constraints is None:
        z = _factorised(h, g)
        return Solution(z * scale * size, float(np.abs(h @ z + g).max()), 0)
    rows = constraints.rows * scale
    lengths = np.maximum(np.linalg.norm(rows, axis=1), np.finfo(float).tiny)
    rows = rows / lengths[:, None]
    low, high = constraints.low / lengths / size, constraints.high / lengths / size
    z, lower, upper = _programme(h, g, rows, low, high)
    kkt = kkt_residual(h, g, rows, low, high, z, upper - lower)
    if not kkt <= KKT_LIMIT:
        raise CalibrationError(
            f"the solver ended with a KKT residual of {kkt:.1e}, expected at most {KKT_LIMIT:.0e}: the recordings "
            "leave the curves undetermined; add a chamber trial, or slow movements that load the whole sole"
        )
    return Solution(z * scale * size, kkt, int(np.count_nonzero((lower > 1e-7) | (upper > 1e-7))))


def _factorised(h: Array, g: Array) -> Array:
    linalg = need("scipy.linalg", "scipy", "a calibration")
    try:
        z: Array = linalg.cho_solve(linalg.cho_factor(h, check_finite=False), -g, check_finite=False)
    except linalg.LinAlgError as error:
        raise CalibrationError(
            "the recordings do not determine the curves: the equations are singular; add a chamber trial, or slow "
            "movements that load the whole sole"
        ) from error
    return z


def _programme(h: Array, g: Array, rows: Array, low: Array, high: Array) -> tuple[Array, Array, Array]:
    """The solution and the multipliers of the lower and the upper limits."""
    piqp = need("piqp", "piqp", "a calibration with constraints")
    solver = piqp.DenseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = 1e-10
    solver.settings.check_duality_gap = True
    solver.settings.eps_duality_gap_abs = solver.settings.eps_duality_gap_rel = 1e-9
    solver.setup(
        np.asfortranarray(h), g, G=np.asfortranarray(rows),
        h_l=np.maximum(low, -_NO_LIMIT), h_u=np.minimum(high, _NO_LIMIT),
    )  # fmt: skip
    solver.solve()  # what came of it is judged by its KKT residual, not by a status
    result = solver.result
    return np.array(result.x), np.array(result.z_l), np.array(result.z_u)


def kkt_residual(h: Array, g: Array, rows: Array, low: Array, high: Array, z: Array, multipliers: Array) -> float:
    """The worst of stationarity, feasibility and complementarity; multipliers (c,): negative at lower limits."""
    at = rows @ z
    above, below = np.maximum(multipliers, 0.0), np.maximum(-multipliers, 0.0)
    return float(
        max(
            np.abs(h @ z + g + rows.T @ multipliers).max(),
            np.maximum(low - at, at - high).max(initial=0.0),
            _slack(above, high - at).max(initial=0.0),
            _slack(below, at - low).max(initial=0.0),
        )
    )


def _slack(multiplier: Array, distance: Array) -> Array:
    """|multiplier · distance|, 0 where there is no limit."""
    return np.abs(multiplier * np.where(np.isfinite(distance), distance, 0.0))
