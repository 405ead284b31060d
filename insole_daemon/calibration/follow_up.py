"""The published follow-up's model, Belli et al. 2023: a cubic of the count, and 40 past counts to the powers 1 to 4.

    P_n = a₃c_n³ + a₂c_n² + a₁c_n + a₀ + Σ_{h=1…40} Σ_{k=1…4} b_hk·c_{n−h}^k

of counts that are smoothed exponentially, s_n = 0.1·c_n + 0.9·s_{n−1}, and pressures, with 0.7, that are paired with
them row by row; rows after which the pressure changes by more than 0.05 bar are dropped first. Its authors train it on
every 32nd row, so on a memory of 26 s, with a penalty of 10⁻³ on coefficients of columns scaled to at most 1, and apply
it to every row, with a memory of 0.8 s: so is it done here. Their solver (OSQP) stops early, this one does not.

Source: Belli et al., Sensors 23 (2023) 4501; ami-iit/paper_belli_2023_sensors_insole-calibration, Code/.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array: TypeAlias = NDArray[np.float64]

POWERS, PAST, PAST_POWERS = 3, 40, 4
COUNT_SHARE, PRESSURE_SHARE = 0.1, 0.7  # of a new value when it is smoothed
EVERY = 32  # rows of which one is trained on
_JUMP_PA = 5000.0
_PENALTY = 1e-3
_MOST_COUNT = 250.0  # where a taxel rests at the most: higher counts are trained on as that


def kept_rows(pressure_pa: Array) -> NDArray[np.intp]:
    """Those rows after which the pressure (n,) stays within 0.05 bar, and the one after the last of them."""
    rows = np.flatnonzero(np.abs(np.diff(pressure_pa)) < _JUMP_PA)
    return np.append(rows, rows[-1] + 1) if rows.size else rows


def smooth_causally(values: Array, share: float) -> Array:
    """Of the rows (n, …), each with its `share` in what there was before; the first is as it is."""
    first = (1.0 - share) * values[:1]
    return np.asarray(lfilter([share], [1.0, share - 1.0], values, axis=0, zi=first)[0])


def train(counts: Array, pressure_pa: Array) -> Array:
    """(m, 164) coefficients in Pa and counts, from smoothed counts (n, m) and the smoothed pressures (n,) they have."""
    rows = slice(EVERY - 1, None, EVERY)
    load = np.maximum(pressure_pa[rows], 0.0)
    return np.stack([_trained(_regressors(np.minimum(c, _MOST_COUNT)), load) for c in counts[rows].T])


def estimate_pressure(counts: Array, coefficients_pa: Array) -> Array:
    """(n, m) Pa of smoothed counts (n, m), every row."""
    said = np.empty_like(counts)
    for taxel, own in enumerate(coefficients_pa):
        count = counts[:, taxel]
        before = _with_past(count)
        past = own[POWERS + 1 :].reshape(PAST, PAST_POWERS)
        said[:, taxel] = np.polyval(own[: POWERS + 1], count)
        for power in range(PAST_POWERS):
            said[:, taxel] += np.convolve(before ** (power + 1), past[:, power], "valid")[: len(count)]
    return said


def _with_past(count: Array) -> Array:
    """(40 + n,): before the first row the count is taken to have been the same."""
    return np.concatenate([np.full(PAST, count[0]), count])


def _regressors(count: Array) -> Array:
    """(n, 164) of one taxel."""
    n, before = len(count), _with_past(count)
    past = [before[PAST - h : PAST - h + n, None] ** np.arange(1, PAST_POWERS + 1) for h in range(1, PAST + 1)]
    return np.concatenate([count[:, None] ** np.arange(POWERS, -1, -1), *past], axis=1)


def _trained(regressors: Array, load_pa: Array) -> Array:
    size = np.abs(regressors).max(axis=0)
    columns = regressors / size
    hessian = columns.T @ columns + _PENALTY * np.eye(columns.shape[1])
    found: Array = np.linalg.solve(hessian, columns.T @ load_pa) / size
    return found
