"""The reference of a recording on a fine grid of its own clock."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.signal import savgol_coeffs, savgol_filter

from ...errors import DiagnosisError
from ...physics.law import Array
from ...recording.document import Clock
from ..operators import cubic_at, low_pass

FINE_S = 0.005  # step of the grid
DENOISE_POINTS, DENOISE_ORDER = 15, 5  # of the fine grid and of polynomials: 99 % of 12 Hz is kept, 24 % of the noise
FINER = 4  # points of a low pass for one of the fine grid
NO_LAG_S = 1e-4  # shorter lags are none
SMOOTH_S = 0.012  # standard deviation of the kernel that removes the noise of single rows from regressors
SHORTEST_S, LONGEST_S, SLOWEST_ROW_S = 1.0, 86_400.0, 5.0  # of a trial; between two rows
PHASES = np.arange(32) / 32  # of a point of the fine grid between two rows
REACH = 8  # rows: the spline of one row is below 1e-4 beyond


def fine_grid(folder: Path, row_time_s: Array) -> Array:
    """Return the times (M,) every FINE_S between the first and the last of the rows `row_time_s` (n,).

    Raises DiagnosisError if the rows are too close or too far apart for the times of one trial in seconds.
    """
    span_s, row_s = float(np.ptp(row_time_s)), float(np.median(np.diff(row_time_s)))
    if not SHORTEST_S <= span_s <= LONGEST_S or row_s > SLOWEST_ROW_S:
        raise DiagnosisError(
            f"{folder}: the rows of the reference are {row_s:.3g} s apart and cover {span_s:.3g} s, expected rows at "
            f"most {SLOWEST_ROW_S:.0f} s apart of one trial of {SHORTEST_S:.0f} s to a day: are the values of time_s "
            "in seconds?"
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
        return replace(self, fine=low_pass(self._finer, FINE_S / FINER, lag_s)[::FINER]) if lag_s >= NO_LAG_S else self

    def at(self, t_s: Array, lag_s: float = 0.0) -> Array:
        """Return the values (n, c) at times `t_s` (n,) of its clock, after a first-order lag."""
        return self._interpolated(self.lagged(lag_s).fine, t_s)

    @cached_property
    def denoised(self) -> ReferenceWrench:
        """Return the reference with less noise, whose delay and curvature are unchanged.

        A polynomial is fitted about each point: A. Savitzky and M. J. E. Golay, Anal. Chem. 36 (1964) 1627.
        """
        return replace(self, fine=_denoised(self.fine))

    def smooth_at(self, t_s: Array, lag_s: float = 0.0) -> Array:
        """Return the values (n, c) as `at`, but without the noise of single rows, for regressors.

        A regressor with the noise of the row that it explains would fit that noise.
        """
        values = self._smooth if lag_s < NO_LAG_S else low_pass(self._smooth, FINE_S, lag_s)
        return self._interpolated(values, t_s)

    @cached_property
    def _finer(self) -> Array:
        """Return the reference FINER times as fine; a low pass takes its rows as joined by lines, which blurs them."""
        return np.asarray(CubicSpline(np.arange(len(self.fine)), self.fine)(np.arange(len(self.fine) * FINER) / FINER))

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
        """Return the share (n,) of the variance of white row noise that `denoised` values have at times `t_s` (n,).

        Cubics between rows and a lag are averages of rows, too.
        """
        return np.interp(t_s / self.row_s, PHASES, _noise_kept(self.row_s, lag_s), period=1.0)

    def echo(self, shift_s: Array, lag_s: float = 0.0) -> tuple[Array, Array]:
        """Return how row noise enters a regressor smooth_at(t) − smooth_at(t − shift) after a lag, (n,) each.

        For noise of variance 1. The first is its covariance with the denoised noise at t, the second its variance.
        """
        kernel_s = np.arange(-400, 801) * (SMOOTH_S / 40)
        kernel = np.exp(-0.5 * (kernel_s / SMOOTH_S) ** 2) / (SMOOTH_S * np.sqrt(2 * np.pi))
        lagged = kernel if lag_s < NO_LAG_S else low_pass(kernel, float(kernel_s[1] - kernel_s[0]), lag_s)
        step_s = float(kernel_s[1] - kernel_s[0])
        covariance, variance = np.empty(len(shift_s)), np.empty(len(shift_s))
        points_s = (np.arange(DENOISE_POINTS) - DENOISE_POINTS // 2) * FINE_S
        weights = savgol_coeffs(DENOISE_POINTS, DENOISE_ORDER)
        by_shift: dict[float, tuple[float, float]] = {}
        for i, shift in enumerate(np.round(shift_s, 4).tolist()):
            if shift not in by_shift:
                shifted = np.interp(kernel_s - shift, kernel_s, lagged, 0.0, 0.0)
                difference = kernel - shifted
                now = float(weights @ np.interp(points_s, kernel_s, difference))
                by_shift[shift] = (now, float(np.sum(difference**2) * step_s))
            covariance[i], variance[i] = by_shift[shift]
        return covariance * self.row_s, variance * self.row_s

    def _interpolated(self, values: Array, t_s: Array) -> Array:
        return cubic_at(values, np.clip(t_s / FINE_S, 1, len(values) - 2.001))


def _denoised(fine: Array) -> Array:
    """Return values (M, c) of the fine grid after the polynomial filter; the ends are on the first and last one."""
    return np.asarray(savgol_filter(fine, DENOISE_POINTS, DENOISE_ORDER, axis=0))


@lru_cache(maxsize=256)  # many delays are tried with the same lag
def _noise_kept(row_s: float, lag_s: float) -> Array:
    """Return the variance of denoised values at the phases PHASES between rows `row_s` apart, whose noise is 1."""
    parts = len(PHASES)  # of FINE_S: the fine grid may lie anywhere between rows, and each part is a grid of its own
    reach_s = REACH * row_s + DENOISE_POINTS * FINE_S
    ends = round((2 * reach_s + 8 * lag_s) / FINE_S) + 2
    t_s = np.arange(ends * parts) * (FINE_S / parts) - reach_s
    one_row = CubicSpline(np.arange(-REACH, REACH + 1), np.arange(-REACH, REACH + 1) == 0)(
        np.clip(t_s / row_s, -REACH, REACH)
    )
    one_row = _denoised(one_row.reshape(ends, parts)).reshape(-1, 1)
    one_row = (low_pass(one_row, FINE_S / parts, lag_s) if lag_s >= NO_LAG_S else one_row)[:, 0]
    rows = np.arange(-np.ceil(reach_s / row_s), np.ceil(t_s[-1] / row_s)) * row_s
    at_s = PHASES[:, None] * row_s + rows
    return np.asarray(np.sum(np.interp(at_s, t_s, one_row, 0.0, 0.0) ** 2, axis=1))
