"""The reference of a recording on a fine grid of its own clock."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from ...errors import DiagnosisError
from ...physics.law import Array
from ...recording.document import Clock
from ..operators import low_pass

FINE_S = 0.005  # step of the grid
SMOOTH_S = 0.012  # standard deviation of the kernel that removes the noise of single rows from regressors
LONGEST_S, SLOWEST_ROW_S = 86_400.0, 5.0  # of a trial; between two rows
PHASES = np.arange(32) / 32  # of a point of the fine grid between two rows
REACH = 8  # rows: the spline of one row is below 1e-4 beyond


def fine_grid(folder: Path, row_time_s: Array) -> Array:
    """Return the times (M,) every FINE_S between the first and the last of the rows `row_time_s` (n,).

    Raises DiagnosisError if the rows are too far apart for the times of one trial in seconds.
    """
    span_s, row_s = float(np.ptp(row_time_s)), float(np.median(np.diff(row_time_s)))
    if span_s > LONGEST_S or row_s > SLOWEST_ROW_S:
        raise DiagnosisError(
            f"{folder}: the rows of the reference are {row_s:.3g} s apart and cover {span_s:.3g} s, expected rows at "
            f"most {SLOWEST_ROW_S:.0f} s apart of one trial of at most a day: are the values of time_s in seconds?"
        )
    return np.arange(row_time_s[0], row_time_s[-1], FINE_S)


@dataclass(frozen=True, eq=False)
class ReferenceWrench:
    """The reference, interpolated by cubics on a fine regular grid of its own clock.

    A wrench has three channels, f_z in N and m_x, m_y in N·m; a pressure has one, or one per triangle, in Pa.
    """

    start_s: float  # its clock at the first row; times count from here
    fine: Array  # (M, c) every FINE_S
    known: NDArray[np.bool_]  # (M,) not in a gap
    noise: Array  # (c,) standard deviation of a row
    clock: Clock
    has_times: bool
    row_s: float  # between two rows
    leaps_s: tuple[tuple[float, float], ...] = ()  # times of leaps, which are left out

    def lagged(self, lag_s: float) -> ReferenceWrench:
        """Return the reference after a first-order lag."""
        return replace(self, fine=low_pass(self.fine, FINE_S, lag_s)) if lag_s >= FINE_S / 50 else self

    def at(self, t_s: Array, lag_s: float = 0.0) -> Array:
        """Return the values (n, c) at times `t_s` (n,) of its clock, after a first-order lag."""
        return self._interpolated(self.lagged(lag_s).fine, t_s)

    def smooth_at(self, t_s: Array, lag_s: float = 0.0) -> Array:
        """Return the values (n, c) as `at`, but without the noise of single rows, for regressors.

        A regressor with the noise of the row that it explains would fit that noise.
        """
        values = self._smooth if lag_s < FINE_S / 50 else low_pass(self._smooth, FINE_S, lag_s)
        return self._interpolated(values, t_s)

    @cached_property
    def _smooth(self) -> Array:
        return np.asarray(gaussian_filter1d(self.fine, SMOOTH_S / FINE_S, axis=0, mode="nearest"))

    def slope(self, t_s: Array) -> Array:
        """Return the rate of change (n, c) at times `t_s` (n,), per second."""
        return self._interpolated(np.gradient(self._smooth, FINE_S, axis=0), t_s)

    def is_known(self, t_s: Array) -> NDArray[np.bool_]:
        """Return whether the reference was recorded at times `t_s` (n,)."""
        position = t_s / FINE_S
        inside = (position >= 1) & (position <= len(self.fine) - 2)
        near = np.rint(np.clip(position, 0, len(self.fine) - 1)).astype(np.intp)
        return np.asarray(inside & self.known[near])

    def noise_kept(self, t_s: Array, lag_s: float = 0.0) -> Array:
        """Return the share (n,) of the variance of white row noise that values at times `t_s` (n,) have, after a lag.

        Cubics between rows, lines between the points of the fine grid and the lag are averages of rows.
        """
        variance, with_next = _noise_of_grid(self.row_s, lag_s)
        point = np.floor(t_s / FINE_S)
        fraction, phase = t_s / FINE_S - point, point * FINE_S / self.row_s
        here, both, following = (
            np.interp(at, PHASES, values, period=1.0)
            for at, values in ((phase, variance), (phase, with_next), (phase + FINE_S / self.row_s, variance))
        )
        return np.asarray((1 - fraction) ** 2 * here + 2 * (1 - fraction) * fraction * both + fraction**2 * following)

    def echo(self, shift_s: Array, lag_s: float = 0.0) -> tuple[Array, Array]:
        """Return how row noise enters a regressor smooth_at(t) − smooth_at(t − shift) after a lag, (n,) each.

        For noise of variance 1, the first is its covariance with the noise of the row at t, the second its variance.
        """
        kernel_s = np.arange(-400, 801) * (SMOOTH_S / 40)
        kernel = np.exp(-0.5 * (kernel_s / SMOOTH_S) ** 2) / (SMOOTH_S * np.sqrt(2 * np.pi))
        lagged = kernel if lag_s < FINE_S / 50 else low_pass(kernel, float(kernel_s[1] - kernel_s[0]), lag_s)
        step_s = float(kernel_s[1] - kernel_s[0])
        covariance, variance = np.empty(len(shift_s)), np.empty(len(shift_s))
        by_shift: dict[float, tuple[float, float]] = {}
        for i, shift in enumerate(np.round(shift_s, 4).tolist()):
            if shift not in by_shift:
                shifted = np.interp(kernel_s - shift, kernel_s, lagged, 0.0, 0.0)
                difference = kernel - shifted
                by_shift[shift] = (float(np.interp(0.0, kernel_s, difference)), float(np.sum(difference**2) * step_s))
            covariance[i], variance[i] = by_shift[shift]
        return covariance * self.row_s, variance * self.row_s

    def _interpolated(self, values: Array, t_s: Array) -> Array:
        position = np.clip(t_s / FINE_S, 0, len(values) - 1.001)
        row = position.astype(np.intp)
        fraction = (position - row)[:, None]
        return np.asarray(values[row] * (1 - fraction) + values[row + 1] * fraction)


@lru_cache(maxsize=256)  # many delays are tried with the same lag
def _noise_of_grid(row_s: float, lag_s: float) -> tuple[Array, Array]:
    """Return the variance of a point of the fine grid, and the covariance with the next, of row noise of variance 1.

    At the phases PHASES between two rows that are `row_s` apart, after a first-order lag.
    """
    parts = len(PHASES)  # of FINE_S: the grid may lie anywhere between rows, and each part is a grid of its own
    ends = round((2 * REACH * row_s + 8 * lag_s) / FINE_S) + 2
    t_s = np.arange(ends * parts) * (FINE_S / parts) - REACH * row_s
    one_row = CubicSpline(np.arange(-REACH, REACH + 1), np.arange(-REACH, REACH + 1) == 0)(
        np.clip(t_s / row_s, -REACH, REACH)
    )
    if lag_s >= FINE_S / 50:
        one_row = low_pass(one_row.reshape(ends, parts), FINE_S, lag_s).ravel()
    rows = np.arange(-REACH, np.ceil(t_s[-1] / row_s)) * row_s
    at_s = PHASES[:, None] * row_s + rows
    here, following = (np.interp(at_s + later_s, t_s, one_row, 0.0, 0.0) for later_s in (0.0, FINE_S))
    return np.sum(here**2, axis=1), np.sum(here * following, axis=1)
