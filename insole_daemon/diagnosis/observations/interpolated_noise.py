"""How the noise of readings enters a column that is computed from them.

Rows lie between readings and are interpolated by cubics, so their noise is less than that of a reading and correlated
from row to row. How much depends on where a row lies between two readings, which differs from board to board.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from ...physics.law import Array
from .grid_readings import LEAST_ROWS
from .wrench import WrenchObservation

DRAWS = 8  # courses of white noise: with 2 000 rows, a relative standard deviation of 1 % of the mean square


def noise_echo(seen: WrenchObservation, change: Callable[[Array], Array]) -> tuple[Array, Array]:
    """Return the noise echo (N, T, 3, 1) of the column that the linear `change` makes of courses (N, k) of readings.

    It is the mean product of the noise in the column with that of the residual, which contains the readings negatively,
    and its mean square (`TermColumns.echo`).
    """
    products, squares = _moments(seen, change)
    variance = seen.counting_variance[..., None]
    return -variance * products[:, None, None], variance * squares[:, None, None]


def echo_of_readings(seen: WrenchObservation, added_slope_pa: Array) -> tuple[Array, Array]:
    """Return the noise echo (N, T, c, 1) of a column that changes with each reading by `added_slope_pa` (N, T, 12)."""
    noise_pa = added_slope_pa * seen.noise_count
    product = -seen.variance_of(seen.slope_at(seen.activation_count) * seen.noise_count * noise_pa)
    _, kept = _moments(seen, lambda courses: courses)
    return product[..., None] * kept[:, None, None], seen.variance_of(noise_pa**2)[..., None] * kept[:, None, None]


def _moments(seen: WrenchObservation, change: Callable[[Array], Array]) -> tuple[Array, Array]:
    """Return the mean products (T,) of rows with what `change` makes of them, and the mean squares of the latter.

    Averaged over the rows, for noise that is white from reading to reading and has a variance of 1 there.
    """

    @cache
    def of_times(times: bytes) -> tuple[float, float]:
        rows = noise_of_rows(times, seen.t_s.tobytes())
        changed = change(rows)
        return float(np.mean(rows * changed)), float(np.mean(changed**2))

    moments = np.zeros((len(seen.readings), 2))
    for row, triangle in enumerate(seen.readings):
        if len(triangle.t_s) >= LEAST_ROWS:
            moments[row] = of_times(triangle.t_s.tobytes())
    return moments[:, 0], moments[:, 1]


@lru_cache(maxsize=32)  # the triangles of an insole: each delay, lag and bit shift asks for the same
def noise_of_rows(read_s: bytes, row_s: bytes) -> Array:
    """Return DRAWS courses (N, DRAWS) of white noise at times of readings, interpolated at those of N rows.

    Both times are those of arrays of float64, s, as bytes.
    """
    at_s, rows_s = np.frombuffer(read_s), np.frombuffer(row_s)
    noise = np.random.default_rng(0).standard_normal((len(at_s), DRAWS))
    return np.asarray(CubicSpline(at_s, noise)(np.clip(rows_s, at_s[0], at_s[-1])))
