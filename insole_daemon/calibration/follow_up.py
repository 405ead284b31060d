"""The published follow-up's model, Belli et al. 2023: a cubic of the count, and 40 past counts to the powers 1 to 4.

    P_n = a₃c_n³ + a₂c_n² + a₁c_n + a₀ + Σ_{h=1…40} Σ_{k=1…4} b_hk·c_{n−h}^k

Counts are smoothed exponentially, s_n = 0.1·c_n + 0.9·s_{n−1}, pressures with 0.7, and they are paired row by row; rows
before a pressure change of more than 0.05 bar are dropped first. The authors train on every 32nd row (a memory of 26 s)
with a penalty of 10⁻³ on the coefficients of columns scaled to at most 1, and apply the model to every row (a memory of
0.8 s). This module does the same. Their solver (OSQP) stops early, this one is exact.

Source: Belli et al., Sensors 23 (2023) 4501; ami-iit/paper_belli_2023_sensors_insole-calibration, Code/.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array: TypeAlias = NDArray[np.float64]

POWERS, PAST, PAST_POWERS = 3, 40, 4
COUNT_SHARE, PRESSURE_SHARE = 0.1, 0.7  # weights of a new value in the exponential mean
EVERY = 32  # training uses one row in so many
_JUMP_PA = 5000.0
_PENALTY = 1e-3
_MAX_COUNT = 250.0  # highest count without load; training clips counts to it


def select_rows(pressure_pa: Array) -> NDArray[np.intp]:
    """Return the rows before a change of pressure (n,) of at most 0.05 bar, and the row after the last of them."""
    rows = np.flatnonzero(np.abs(np.diff(pressure_pa)) < _JUMP_PA)
    return np.append(rows, rows[-1] + 1) if rows.size else rows


def smooth_causally(values: Array, share: float) -> Array:
    """Return the exponential mean of the rows (n, …) with weight `share` of a new row; the first row is unchanged."""
    state = (1.0 - share) * values[:1]
    return np.asarray(lfilter([share], [1.0, share - 1.0], values, axis=0, zi=state)[0])


def train(counts: Array, pressure_pa: Array) -> Array:
    """Return (m, 164) coefficients in Pa and counts, fitted to smoothed counts (n, m) and smoothed pressures (n,)."""
    rows = slice(EVERY - 1, None, EVERY)
    load = np.maximum(pressure_pa[rows], 0.0)
    return np.stack([_fit_ridge(_regressors(np.minimum(c, _MAX_COUNT)), load) for c in counts[rows].T])


def estimate_pressure(counts: Array, coefficients_pa: Array) -> Array:
    """Return (n, m) pressures in Pa from smoothed counts (n, m), for every row."""
    pressure_pa = np.empty_like(counts)
    for taxel, taxel_coefficients in enumerate(coefficients_pa):
        count = counts[:, taxel]
        extended = _prepend_past(count)
        past_coefficients = taxel_coefficients[POWERS + 1 :].reshape(PAST, PAST_POWERS)
        pressure_pa[:, taxel] = np.polyval(taxel_coefficients[: POWERS + 1], count)
        for power in range(PAST_POWERS):
            pressure_pa[:, taxel] += np.convolve(extended ** (power + 1), past_coefficients[:, power], "valid")[
                : len(count)
            ]
    return pressure_pa


def _prepend_past(count: Array) -> Array:
    """Return (40 + n,) counts; before the first row the count is assumed constant."""
    return np.concatenate([np.full(PAST, count[0]), count])


def _regressors(count: Array) -> Array:
    """Return (n, 164) regressors of one taxel."""
    n, extended = len(count), _prepend_past(count)
    past = [extended[PAST - h : PAST - h + n, None] ** np.arange(1, PAST_POWERS + 1) for h in range(1, PAST + 1)]
    return np.concatenate([count[:, None] ** np.arange(POWERS, -1, -1), *past], axis=1)


def _fit_ridge(regressors: Array, load_pa: Array) -> Array:
    size = np.abs(regressors).max(axis=0)
    columns = regressors / size
    hessian = columns.T @ columns + _PENALTY * np.eye(columns.shape[1])
    coefficients: Array = np.linalg.solve(hessian, columns.T @ load_pa) / size
    return coefficients
