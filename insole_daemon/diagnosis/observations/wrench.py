"""Observe a recording with a force shoe or plate: pressures of all taxels and the reference wrench, on one time grid.

Uncertainty from gaps, fast edges and noisy taxels enters the variance of a row; no row is deleted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter1d

from ...physics.calibration import Calibration
from ...physics.law import Array
from ...skin.layout import Layout
from .grid_readings import LEAST_ROWS
from .readings import TriangleReadings
from .reference_wrench import ReferenceWrench
from .static_curves import StaticCurves, turning_count

CHANNELS = ("fz_n", "mx_nm", "my_nm")
JITTER_S = 0.001  # of a time stamp, beyond the regular clock of a board
BETWEEN_ROWS = (  # ratio of the error of interpolation between rows to that at twice the period
    0.25  # of the interpolation error at twice the period: that between rows, if readings hardly resolve edges
)
LEAST_TIMING_S = 0.003  # shortest delay or lag: three standard deviations of a declared clock's offset
CLEAR = 3.0  # standard deviations of noise
SMALLEST, LARGEST = 0.6, 254.4  # range of counts that are not at an end
MOST_CLIPPED = 0.2  # share of a triangle's taxels
LONG_PAUSE_S = 0.15  # of readings: linear interpolation does not follow a step
UNKNOWN_LOAD = 25.0  # variance of the load in long gaps, as a multiple of the usual one, from which a row is not used
ABOVE_READINGS = 5.0  # counts above the highest reading, to which curves are used

# Fields of an observation that have an entry for each row.
BY_ROW = (
    "t_s", "activation_count", "missing", "temperature_c", "noise_ratio", "rezeroed", "unloaded", "undone_change",
)  # fmt: skip
# Computed properties that are the same with other curves, or on another clock of the reference.
CURVE_INDEPENDENT = ("clipped", "cut_off", "saturated", "smooth_count", "_signal_vectors")
CLOCK_INDEPENDENT = (*CURVE_INDEPENDENT, "arms", "by_triangle", "coefficients", "columns_of_readings")
NOISE_EDGE = 1.05  # factor on the largest singular value of white noise


@dataclass(frozen=True, eq=False)
class WrenchObservation:
    """One foot of one recording: N rows on a regular grid, T triangles of 12 taxels."""

    name: str
    layout: Layout
    calibration: Calibration
    t_s: Array  # (N,) since the recording's first cycle
    period_s: Array  # (T,) between two readings of each triangle
    activation_count: Array  # (N, T, 12) baseline − count; 0 for taxels that are not used
    usable: NDArray[np.bool_]  # (T, 12) taxels whose readings are used
    missing: NDArray[np.bool_]  # (N, T) rows in a gap of the triangle's readings, or in which a burst biases them
    noise_count: Array  # (T, 12) standard deviation of a reading
    reference: ReferenceWrench
    offset_s: float  # time of the reference's clock at t_s = 0
    rate: float  # of the reference's clock, less 1
    declared_offset_s: float | None  # if the reference is declared to have the CAN clock, else None
    offset_is_free: bool  # the clock's offset is unknown, or the declared one is wrong
    rate_is_free: bool  # the clock's rate is unknown
    temperature_c: Array | None  # (N,) °C; counts of the thermal pads if no thermometer was recorded
    readings: tuple[TriangleReadings, ...]
    noise_ratio: Array | None = None  # (N, T) noise of readings over `noise_count`
    rezeroed: NDArray[np.bool_] | None = None  # (N, T) rows since a board's re-zero, already corrected
    is_wholly_substituted: NDArray[np.bool_] | None = None  # (T,) triangles whose readings are the mean of others
    unloaded: NDArray[np.bool_] | None = None  # (N, T, 12) readings at the top of their range: no load, activation 0
    rate_std: float = 0.0  # standard deviation of a free clock's rate
    temperature_is_in_counts: bool = False
    is_estimated: NDArray[np.bool_] | None = None  # (T,) uncalibrated triangles, converted by the curves of others
    has_own_curves: bool = False  # fitted to the rows, because there is no calibration
    handed_in: Calibration | None = None  # if curves were corrected
    ruled_out: frozenset[str] = frozenset()  # words of effects that another recording of the insole rules out
    undone: frozenset[str] = frozenset()  # words of memories without which the rows were read
    undone_change: Array | None = None  # (N, 3) of the wrench by these memories
    load_is_known = False  # on every taxel; else only the wrench is known
    is_uniform = False  # whether all taxels bear the same load

    @property
    def step_s(self) -> float:
        """Return the time between two rows."""
        return float(self.t_s[1] - self.t_s[0])

    @property
    def least_lag_s(self) -> float:
        """Return the shortest lag of the whole insole that can be identified.

        To the first order a shorter one is a delay within the tolerance of a declared clock.
        """
        return LEAST_TIMING_S

    @property
    def edge_delay_s(self) -> float:
        """By how much the readings' edges are later than those of the load; 0 where nothing tells it."""
        return 0.0

    @property
    def latest_s(self) -> float:
        """Return by how much readings may have been taken before their times, which is no delay of the insole."""
        return max(triangle.latest_s for triangle in self.readings)

    @cached_property
    def clipped(self) -> NDArray[np.bool_]:
        """Return where so many taxels of a triangle are at an end of their range that its load is unknown, (N, T)."""
        return np.asarray(self.cut_off.sum(axis=2) > MOST_CLIPPED * self.usable.sum(axis=1))

    @cached_property
    def saturated(self) -> NDArray[np.bool_]:
        """Return where a taxel of a triangle is saturated, (N, T)."""
        return np.asarray((self.cut_off & (self.activation_count > 0.5 * np.nanmax(self.activation_count))).any(axis=2))

    @cached_property
    def cut_off(self) -> NDArray[np.bool_]:
        """Return which taxels are at an end of their range, (N, T, 12)."""
        count = self.calibration.baseline_count - self.activation_count
        is_invalid = np.stack([triangle.is_invalid_near(self.t_s) for triangle in self.readings], axis=1)
        at_end = (count > LARGEST) | (count < SMALLEST) | is_invalid
        return np.asarray(self.usable & (at_end if self.unloaded is None else at_end | self.unloaded))

    def with_unloaded(self) -> Self:
        """Return the observation with activation 0 for readings that are at the top of their range and below no load.

        A taxel cannot be pulled: such a reading is unloaded, and temperature or a re-zero under load moved it there.
        """
        count = self.calibration.baseline_count - self.activation_count
        unloaded = np.asarray(self.usable & (count > LARGEST) & (self.activation_count < 0.0))
        if not unloaded.any():
            return self
        return replace(self, activation_count=np.where(unloaded, 0.0, self.activation_count), unloaded=unloaded)

    def nearest(self, row: int) -> NDArray[np.intp]:
        """Return the triangles (T,) by the distance of their centres from that of triangle `row`, itself first."""
        centres = self.layout.xy_m.mean(axis=1)
        return np.asarray(np.argsort(np.linalg.norm(centres - centres[row], axis=1)))

    def zero_where_unloaded(self, values: Array) -> Array:
        """Return `values` (N, T, 12) with 0 at readings at the top of their range, which no small shift changes."""
        return values if self.unloaded is None else np.where(self.unloaded, 0.0, values)

    @cached_property
    def expected_count(self) -> Array:
        """Return the activation (N, T, 12) under the known load; if it is unknown, the reading."""
        return self.activation_count

    @cached_property
    def arms(self) -> Array:
        """Return the contribution (T, 12, 3) of a pascal on each taxel to f_z, m_x and m_y; 0 for taxels not used."""
        xy = self.layout.xy_m
        arms = self.layout.taxel_area_m2 * np.stack([np.ones(xy.shape[:2]), xy[..., 1], -xy[..., 0]], axis=-1)
        return np.asarray(arms * self.usable[..., None])

    @cached_property
    def coefficients(self) -> Array:
        """Return the coefficients (k, T, 12) of the static curves, Pa; 0 for taxels that are not used."""
        coefficients = np.moveaxis(self.calibration.coefficients_pa, -1, 0) * 1.0
        coefficients = np.concatenate(
            [coefficients, np.zeros((max(2 - len(coefficients), 0), *coefficients.shape[1:]))]
        )
        return np.where(self.usable, coefficients, 0.0)

    @property
    def has_free_curves(self) -> bool:
        """Return whether the curves are corrected or fitted, so that a constant error of the reference is in them."""
        return self.has_own_curves or self.handed_in is not None

    @property
    def as_handed_in(self) -> Self:
        """Return the same rows with the curves that were handed in."""
        return self if self.handed_in is None else replace(self, calibration=self.handed_in, handed_in=None)

    @cached_property
    def top_count(self) -> Array:
        """Return the activation (T, 12) above which the curves are straight."""
        used = np.full(self.usable.shape, float(self.activation_count.max()) + ABOVE_READINGS)
        if self.calibration.highest_count is not None:
            np.minimum(used, self.calibration.highest_count, out=used, where=self.usable)
        return np.where(self.usable, np.minimum(used, turning_count(self.coefficients, used)), used)

    @cached_property
    def _curves(self) -> StaticCurves:
        return StaticCurves(self.coefficients, self.top_count)

    @property
    def pressure_pa(self) -> Array:
        """Return the pressure (N, T, 12) by the static curves."""
        return self.static_pa(self.activation_count)

    @cached_property
    def smooth_count(self) -> Array:
        """Return the activation (N, T, 12) with noise reduced.

        The readings of a foot have a low rank, so singular vectors below the largest singular value of white noise are
        removed (V. A. Marchenko & L. A. Pastur, Math. USSR-Sb. 1 (1967) 457).
        """
        scaled, noise = self._scaled
        smooth = np.zeros((len(self.t_s), self.usable.size))
        smooth[:, self.usable.ravel()] = (scaled @ self._signal_vectors) @ self._signal_vectors.T * noise
        return smooth.reshape(self.activation_count.shape)

    @cached_property
    def smooth_noise_count(self) -> Array:
        """Return the standard deviation (T, 12) of the noise that is left in `smooth_count`; 0 if not used."""
        left = np.zeros(self.usable.size)
        left[self.usable.ravel()] = self._scaled[1] * np.linalg.norm(self._signal_vectors, axis=1)
        return left.reshape(self.usable.shape)

    @property
    def _scaled(self) -> tuple[Array, Array]:
        """Return the activation (N, m) of the taxels in use in standard deviations of its noise, and these (m,)."""
        usable = self.usable.ravel()
        noise = np.maximum(self.noise_count.ravel()[usable], 0.1)
        return self.activation_count.reshape(len(self.t_s), -1)[:, usable] / noise, noise

    @cached_property
    def _signal_vectors(self) -> Array:
        """Return the singular vectors (m, r) of the scaled readings that are above noise."""
        scaled, _ = self._scaled
        eigenvalues, eigenvectors = np.linalg.eigh(scaled.T @ scaled)
        noise_edge = NOISE_EDGE * (np.sqrt(scaled.shape[0]) + np.sqrt(scaled.shape[1]))
        return np.asarray(eigenvectors[:, eigenvalues > noise_edge**2])

    def static_pa(self, activation_count: Array) -> Array:
        """Return the pressure (N, T, 12) by the static curves, straight below zero and above `top_count`."""
        return self._curves.pressure_pa(activation_count)

    @property
    def slope_pa(self) -> Array:
        """Return the slope (N, T, 12) of the curves at the readings, Pa per count."""
        return self.zero_where_unloaded(self.slope_at(self.activation_count))

    def slope_at(self, activation_count: Array) -> Array:
        """Return the slope (N, T, 12) of the curves at an activation, Pa per count (`StaticCurves.slope_pa`)."""
        return self._curves.slope_pa(activation_count)

    @cached_property
    def by_triangle(self) -> Array:
        """Return the wrench (N, T, 3) of each triangle by the static curves."""
        return self.wrench_of(self.pressure_pa)

    @property
    def wrench(self) -> Array:
        """Return the wrench (N, 3) of the insole by the static curves."""
        return np.asarray(self.by_triangle.sum(axis=1))

    @property
    def mean_square_error(self) -> Array:
        """Return the mean square error (3,) of the wrench by the static curves, N² and N²·m²."""
        known = self.reference.is_known(self.reference_s)
        return np.asarray(np.mean((self.wrench - self.reference.smooth_at(self.reference_s))[known] ** 2, axis=0))

    def wrench_of(self, pressure_pa: Array) -> Array:
        """Return the wrench (N, T, 3) of each triangle under pressures (N, T, 12), Pa."""
        return np.asarray(np.matmul(pressure_pa.transpose(1, 0, 2), self.arms).transpose(1, 0, 2))

    @property
    def load_course(self) -> Array:
        """Return the course (N,) of the load by the reference: its mean pressure, Pa, or the vertical force, N."""
        load = self.reference.at(self.reference_s)
        return np.asarray(load.mean(axis=1) if self.load_is_known else load[:, 0])

    @cached_property
    def reference_s(self) -> Array:
        """Return the time of the reference's clock at every row (N,)."""
        return self.offset_s + (1.0 + self.rate) * self.t_s

    def with_clock(self, offset_s: float, rate: float) -> Self:
        """Return the same rows with another clock of the reference."""
        return self.timed(offset_s=offset_s, rate=rate)

    def timed(self, **clock: Any) -> Self:
        """Return the same rows with other fields of the `clock`; computed properties in CLOCK_INDEPENDENT are kept."""
        return self.replaced_keeping(CLOCK_INDEPENDENT, **clock)

    def replaced_keeping(self, computed: Sequence[str], **changed: Any) -> Self:
        """Return a copy with other fields, which keeps the `computed` properties that do not depend on these."""
        copy = replace(self, **changed)
        vars(copy).update({name: value for name, value in vars(self).items() if name in computed})
        return copy

    @cached_property
    def columns_of_readings(self) -> dict[str, Any]:
        """Return the columns of terms that depend on the readings alone, by word; each clock has the same."""
        return {}

    def rows_before(self, row: int) -> Self:
        """Return the rows before `row`."""
        return replace(self, **{name: rows[:row] for name in BY_ROW if (rows := getattr(self, name)) is not None})

    @cached_property
    def counting_variance(self) -> Array:
        """Return the variance (N, T, 3) of each triangle's wrench by the noise of its readings."""
        return self.variance_of((self.slope_pa * self.noise_count) ** 2)

    def variance_of(self, variance_pa2: Array) -> Array:
        """Return the variance (N, T, 3) of each triangle's wrench by that of its taxels (N, T, 12), at usual noise."""
        variance = np.asarray(np.matmul(variance_pa2.transpose(1, 0, 2), self.arms**2).transpose(1, 0, 2))
        return variance if self.noise_ratio is None else variance * self.noise_ratio[..., None] ** 2

    @cached_property
    def interpolation_error(self) -> dict[int, tuple[Array, Array]]:
        """Return by board the error (N, 3) of the reference interpolated by cubics through the board's reading times.

        The first is that of the smooth reference, for regressors, and 0 up to CLEAR times the noise of the reference: a
        regressor would average that noise. The second is that of the reference itself, and 0 where the first is less
        than the noise of a row, which hides it.
        """
        boards, noise = self.layout.identities[:, 0], self.reference.noise

        def both_at(t_s: Array) -> Array:
            return np.concatenate([self.reference.smooth_at(t_s), self.reference.at(t_s)], axis=1)

        errors, in_rows = {}, both_at(self.reference_s)
        for board in np.unique(boards):
            read_s = next((self.readings[row].t_s for row in np.flatnonzero(boards == board)), np.empty(0))
            if len(read_s) < LEAST_ROWS:
                continue
            between = CubicSpline(read_s, both_at(self.offset_s + (1.0 + self.rate) * read_s))
            smooth, error = np.split(between(np.clip(self.t_s, read_s[0], read_s[-1])) - in_rows, 2, axis=1)
            errors[int(board)] = (
                np.where(np.abs(smooth) > CLEAR * noise, smooth, 0.0), np.where(np.abs(smooth) > noise, error, 0.0)
            )  # fmt: skip
        return errors

    @cached_property
    def weight_variance(self) -> Array:
        """Return the variance (N, 3) of a row, N² and N²·m²; inf where the reference or most of the load is unknown.

        It consists of the noise of readings and reference, of time stamps and interpolation at edges, and of gaps.
        """
        counting = self.counting_variance.sum(axis=1)
        boards = self.layout.identities[:, 0]
        edges = np.zeros_like(counting)
        for board in np.unique(boards):
            of_board = boards == board
            wrench_of_board = self.by_triangle[:, of_board].sum(axis=1)
            slope = np.gradient(wrench_of_board, self.step_s, axis=0)
            period_s = float(np.median(self.period_s[of_board]))
            interpolation = (
                np.abs(cubic_error(wrench_of_board, self.step_s, period_s))
                if np.isfinite(period_s)
                else np.zeros_like(wrench_of_board)
            )
            interpolation = np.maximum(
                interpolation - CLEAR * np.sqrt(self.counting_variance[:, of_board].sum(axis=1)), 0.0
            )
            edges += (JITTER_S * slope) ** 2 + (BETWEEN_ROWS * maximum_filter1d(interpolation, 3, axis=0)) ** 2
        gaps = np.einsum("nt,ntc->nc", self.missing, self.by_triangle**2) * 0.25
        variance = counting + self.reference.noise**2 + edges + gaps
        # The load of a step in a long gap is unknown, and the gap is common to all triangles of a board.
        in_long_gap = np.stack([triangle.in_gap(self.t_s, LONG_PAUSE_S) for triangle in self.readings], axis=1)
        of_long_gaps = (in_long_gap.astype(np.float64) @ np.sqrt(np.mean(self.by_triangle**2, axis=0))) ** 2
        is_unknown = ~self.reference.is_known(self.reference_s)
        is_unknown |= of_long_gaps[:, 0] > UNKNOWN_LOAD * np.median(variance[:, 0])
        variance += of_long_gaps
        variance[is_unknown] = np.inf
        return np.asarray(variance)


def cubic_error(course: Array, step_s: float, period_s: float) -> Array:
    """Return the error (N, c) of predicting rows from those one and three periods before and after, by a cubic.

    Between two readings the distances are half of that, so interpolation has a smaller error: BETWEEN_ROWS of it where
    readings hardly resolve the course.
    """
    three_periods = 3 * max(round(period_s / step_s), 1)
    error = np.zeros_like(course)
    sum_near = (
        course[2 * three_periods // 3 : len(course) - 4 * three_periods // 3]
        + course[4 * three_periods // 3 : len(course) - 2 * three_periods // 3]
    )
    sum_far = course[: len(course) - 2 * three_periods] + course[2 * three_periods :]
    error[three_periods:-three_periods] = course[three_periods:-three_periods] - (9.0 * sum_near - sum_far) / 16.0
    return error
