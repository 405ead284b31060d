"""Observe a recording whose load is known on every taxel: pressures by triangle and the reference pressure on one grid.

Under a uniform load the taxels of a triangle are replicates, so the regression uses their mean, weighted by their
precision. The reference is the load of every triangle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import median_filter, percentile_filter
from scipy.signal import savgol_filter
from scipy.stats import trim_mean

from ...calibration.clock import Clock
from ...errors import CalibrationError, DiagnosisError
from ...physics.calibration import Calibration
from ...physics.law import Array
from ...recording.loading import FootRecording, Recording
from ...recording.reference import Reference
from ..contact import stretches
from .alignment import MOST_CLOCK_ERROR_S, fit_own_clock
from .grid_readings import LEAST_ROWS, read_rows, row_times, temperature_at
from .reference_wrench import FINE_S, ReferenceWrench, fine_grid
from .wrench import ABOVE_READINGS, CURVE_INDEPENDENT, JITTER_S, LEAST_TIMING_S, WrenchObservation

LEAST_RISE_PA = 1e4  # smallest range of the reference's pressure
SMOOTH_S, SMOOTH_ROWS, DEGREE = 0.06, 3, 3  # half the window of the reference's filter, and its degree
NOISE_KEPT = 2.25  # share of the noise variance that a cubic fit keeps, times its rows (Savitzky & Golay 1964)
N_TABLE = 400  # points of each static curve in its inversion
LEAST_LAG_PERIODS = 0.5  # shortest lag on a free clock, in periods of the readings
LEAP_S, LEAP_SHARE, LEAP_SIGMAS = 0.05, 0.02, 20.0  # longest leap; smallest, of the range and in usual deviations
LEAST_SPAN_SHARE = 0.2  # of the span of the most responsive taxels, that a taxel needs to be used for the alignment
LEAST_SPAN_COUNT = 2.0  # of the most responsive taxel
LESS_UNEXPLAINED = 0.85  # ratio of unexplained shares below which a single board, or a moved clock, is used
LEAST_AGREEMENT = 0.8  # squared correlation with the load below which a declared clock may be far off
LEAST_COVERED = 0.3  # share of the readings' time that the reference covers


@dataclass(frozen=True, eq=False)
class ChamberObservation(WrenchObservation):
    """One foot of one recording in a pressure chamber or bag; the channels are the mean pressures of T triangles, Pa.

    `lag_s`: time constant of a first-order lag between the reference and the load on the taxels.
    """

    lag_s: float = 0.0
    settled: frozenset[tuple[str, str]] = frozenset()  # effects and scopes, detected or ruled out
    switching_pa: Array | None = None  # (N, T) error of the load while taxels of a triangle snap, each at its own load

    load_is_known = True
    is_uniform = True

    @cached_property
    def arms(self) -> Array:
        """Return the weights (T, 12, 1) of taxels in their triangle's mean, by the precision of a reading; sum 1."""
        slope = np.mean(self.slope_pa, axis=0)
        precision = np.where(self.usable, 1.0 / np.maximum(slope * np.maximum(self.noise_count, 0.1), 1e-9) ** 2, 0.0)
        return np.asarray((precision / np.maximum(precision.sum(axis=1, keepdims=True), 1e-300))[..., None])

    @property
    def least_lag_s(self) -> float:
        """Return the shortest lag that can be identified.

        On a free clock a lag shows only in the shape of edges, which readings resolve to a part of their period.
        """
        period_s = float(np.median(self.period_s[np.isfinite(self.period_s)]))
        return max(LEAST_TIMING_S, LEAST_LAG_PERIODS * period_s) if self.offset_is_free else LEAST_TIMING_S

    @property
    def is_declared_clock_doubtful(self) -> bool:
        """Return whether the edges contradict the declared clock, and the clock is that of the edges."""
        return self.offset_is_free and self.declared_offset_s is not None

    def with_declared_clock(self) -> ChamberObservation:
        """Return the same rows on the declared clock."""
        assert self.declared_offset_s is not None
        return replace(self.with_clock(self.declared_offset_s, 0.0), offset_is_free=False)

    def with_curves(self, coefficients_pa: Array) -> ChamberObservation:
        """Return the same rows with other static curves (T, 12, k), Pa, up to the highest reading of each taxel."""
        highest_count = np.maximum(self.activation_count.max(axis=0), 1.0)
        curves = replace(self.calibration, coefficients_pa=coefficients_pa, highest_count=highest_count)
        handed_in = self.handed_in or self.calibration
        return self.replaced_keeping(CURVE_INDEPENDENT, calibration=curves, handed_in=handed_in)

    @cached_property
    def edge_delay_s(self) -> float:
        """Return the delay of the readings' edges in the middle of the recording, s; 0 where they do not tell it."""
        try:
            clock = _edge_clock(self)
        except CalibrationError:
            return 0.0
        middle_s = np.array([(self.t_s[0] + self.t_s[-1]) / 2])
        return float(self.offset_s + middle_s[0] - clock.reference_s(middle_s)[0])

    def load_pa(self, at_s: Array) -> Array:
        """Return the pressure (n, 1, 1) on every taxel, Pa, at times (n,) of the reference's clock."""
        return self.reference.smooth_at(at_s, self.lag_s)[:, :, None]

    @cached_property
    def expected_count(self) -> Array:
        """Return the activation (N, T, 12) in counts that the static curves have under the load of the reference."""
        return self.activation_at(self.reference.at(self.reference_s, self.lag_s)[:, :, None])

    @cached_property
    def usual_slope_pa(self) -> Array:
        """Return the slope (N, T, 12) of the curves, Pa per count, between readings with noise reduced and expected."""
        return self.mean_slope_at(self.smooth_count)

    def mean_slope_at(self, activation_count: Array) -> Array:
        """Return the mean (N, T, 12) of the slopes of the curves at an activation and at the expected one."""
        slope = self.slope_at(activation_count)
        slope += self.slope_at(self.expected_count)
        slope *= 0.5
        return slope

    def activation_at(self, pressure_pa: Array) -> Array:
        """Return the activation (N, T, 12), counts, by the static curves under pressures that broadcast to this shape.

        The curves are inverted by a table; below zero load and above the table they go on as straight lines.
        """
        lowest_count = min(float(self.activation_count.min()), 0.0) - ABOVE_READINGS
        grid_count = np.linspace(lowest_count, float(self.activation_count.max()) + ABOVE_READINGS, N_TABLE)
        shape = (N_TABLE, *self.usable.shape)
        table_pa = np.maximum.accumulate(self.static_pa(np.broadcast_to(grid_count[:, None, None], shape)), axis=0)
        steepness = np.maximum(self.slope_at(np.broadcast_to(grid_count[-1], (1, *self.usable.shape)))[0], 1.0)
        activation = np.zeros(self.activation_count.shape)
        load_pa = np.broadcast_to(pressure_pa, activation.shape)
        for t, k in np.argwhere(self.usable).tolist():
            above_pa = np.maximum(load_pa[:, t, k] - table_pa[-1, t, k], 0.0)
            activation[:, t, k] = np.interp(load_pa[:, t, k], table_pa[:, t, k], grid_count)
            activation[:, t, k] += above_pa / steepness[t, k]
        return activation

    def load_less(self, moved_pa: Array, apart_pa: Array | float = 0.0) -> Array:
        """Return the load (N, T, 12) of every taxel, Pa, less the change of its triangle `moved_pa` (N, T) and its own.

        `apart_pa` (N, T, 12) is the change of a taxel beyond that of its triangle.
        """
        return np.asarray((self.reference.at(self.reference_s) - moved_pa)[:, :, None] - apart_pa)

    @cached_property
    def counting_variance(self) -> Array:
        """Return the variance (N, T, 1) of each triangle's mean pressure by the noise of its readings, Pa²."""
        return self.variance_of((self.slope_at(self.expected_count) * self.noise_count) ** 2)

    @property
    def wrench(self) -> Array:
        """Return the mean pressure (N, T) of each triangle by the static curves, Pa."""
        return np.asarray(self.by_triangle[..., 0])

    @cached_property
    def weight_variance(self) -> Array:
        """Return the variance (N, T) of a row, Pa²; inf where it is unknown.

        It consists of the noise of readings, of time stamps and of the reference, and of snaps.
        """
        counting = self.counting_variance[..., 0]
        slope = self.reference.slope(self.reference_s)
        variance = counting + self.reference.noise**2 + (JITTER_S * slope) ** 2
        if self.switching_pa is not None:
            variance = variance + self.switching_pa**2
        variance = np.where(self.missing | ~self.usable.any(axis=1), np.inf, variance)
        variance[self.clipped | self.saturated] = np.inf
        variance[~self.reference.is_known(self.reference_s)] = np.inf
        return np.asarray(variance)


def observe_chamber(recording: Recording, foot: FootRecording, calibration: Calibration) -> ChamberObservation:
    """Return the observation of `foot` under the pressure of its reference, which is that of every taxel.

    Raises DiagnosisError if there is no reference, no taxel responds to it, or it covers too little of the recording.
    """
    reference = foot.reference
    if reference is None:
        raise DiagnosisError(f"{recording.folder}: expected the pressure of a {recording.kind}, found no reference")
    rows = read_rows(recording, foot, calibration, np.median)
    pressure = _reference(recording, foot, reference)
    declared = foot.t_ns[0] * 1e-9 - pressure.start_s if pressure.has_times and pressure.clock == "can" else None
    observation = ChamberObservation(
        name=recording.folder.name, layout=foot.layout, calibration=calibration, t_s=rows.t_s, period_s=rows.period_s,
        activation_count=rows.activation_count, usable=rows.usable, missing=rows.missing, noise_count=rows.noise_count,
        reference=pressure, offset_s=declared or 0.0, rate=0.0, declared_offset_s=declared,
        offset_is_free=declared is None, rate_is_free=declared is None, temperature_c=None, readings=rows.readings,
    )  # fmt: skip
    if not np.max(_span_of_counts(observation), where=observation.usable, initial=0.0) > LEAST_SPAN_COUNT:
        raise DiagnosisError(f"{recording.folder}: no taxel answers the pressure: was the insole in the chamber?")
    if declared is None:
        observation = _with_fitted_clock(recording, observation)
    elif (agreement := _agreement(observation)) < LEAST_AGREEMENT:
        realigned = _with_fitted_clock(recording, observation)
        if abs(realigned.offset_s - declared) > MOST_CLOCK_ERROR_S and 1.0 - _agreement(
            realigned
        ) < LESS_UNEXPLAINED * (1.0 - agreement):
            observation = replace(realigned, offset_is_free=True)
    covered = float(pressure.is_known(observation.reference_s).mean())
    if covered < LEAST_COVERED:
        raise DiagnosisError(
            f"{recording.folder}: the reference covers {covered:.0%} of the readings, expected at least "
            f"{LEAST_COVERED:.0%}: is it of the same trial, and did it run all the time?"
        )
    return replace(observation, temperature_c=temperature_at(foot, pressure.start_s, observation.reference_s))


def _reference(recording: Recording, foot: FootRecording, reference: Reference) -> ReferenceWrench:
    """Return the pressure on a fine grid (M, 1), Pa, smoothed by cubics over a window.

    Leaps are left out. The noise is estimated from third differences, by their median absolute value. Source of the
    filter: A. Savitzky & M. J. E. Golay, Anal. Chem. 36 (1964) 1627.
    """
    pressure = reference["pressure_pa"]
    time_s = row_times(foot, reference.time_s, len(pressure))
    is_good = np.isfinite(pressure) & (np.diff(time_s, prepend=-np.inf) > 0)
    range_pa = float(np.ptp(pressure[is_good])) if is_good.any() else 0.0
    if is_good.sum() < LEAST_ROWS or not range_pa > LEAST_RISE_PA:
        raise DiagnosisError(
            f"{recording.folder}: the pressure of the reference stays within {range_pa / 1e3:.1f} kPa, expected one "
            f"that rises and falls by more than {LEAST_RISE_PA / 1e3:.0f} kPa: was the chamber recorded?"
        )
    is_leap = np.zeros(len(is_good), bool)
    is_leap[is_good] = _find_leaps(time_s[is_good], pressure[is_good])
    leaps_s = tuple(
        (float(time_s[a] - time_s[is_good][0]), float(time_s[b] - time_s[is_good][0])) for a, b in stretches(is_leap)
    )
    is_good &= ~is_leap
    row_time_s, row_pa = time_s[is_good] - time_s[is_good][0], pressure[is_good][:, None]
    grid_s = fine_grid(recording.folder, row_time_s)
    after = np.searchsorted(row_time_s, grid_s, side="right").clip(1, len(row_time_s) - 1)
    period_s = float(np.median(np.diff(row_time_s)))
    window_rows = 2 * max(round(SMOOTH_S / period_s), SMOOTH_ROWS) + 1
    known = row_time_s[after] - row_time_s[after - 1] < max(0.25, 3.0 * period_s)
    noise = np.median(np.abs(np.diff(row_pa, n=3, axis=0)), axis=0) / np.sqrt(20.0) / 0.6745
    # A moving average would bend the course of the load, which the regression would take for memory.
    window = 2 * round(window_rows * period_s / FINE_S / 2) + 1
    fine_pa = savgol_filter(CubicSpline(row_time_s, row_pa)(grid_s), window, DEGREE, axis=0)
    noise = noise * np.sqrt(NOISE_KEPT / window_rows)
    return ReferenceWrench(
        float(time_s[is_good][0]), fine_pa, known, noise, reference.clock,
        reference.time_s is not None, period_s, leaps_s,
    )  # fmt: skip


def _find_leaps(time_s: Array, pressure_pa: Array) -> NDArray[np.bool_]:
    """Return the rows (n,) that deviate from those before and after for LEAP_S at most: no pressure changes so fast.

    A row is compared with the median of its neighbours and with straight lines through those of either side, which
    reach a turning point of the pressure; the smallest deviation counts.
    """
    row_s = float(np.median(np.diff(time_s)))
    half_rows = max(round(LEAP_S / row_s), 1)
    width_rows, rows = 2 * half_rows + 1, np.arange(len(pressure_pa))
    predictions = [median_filter(pressure_pa, width_rows, mode="nearest")]
    for side in (-half_rows, half_rows):
        near, far = (pressure_pa[np.clip(rows + k * side, 0, len(rows) - 1)] for k in (1, 2))
        predictions.append(2.0 * near - far)
    deviation = np.min(np.abs(pressure_pa - np.stack(predictions)), axis=0)
    level_nearby = percentile_filter(deviation, 90, 8 * width_rows + 1)
    least_deviation = max(LEAP_SHARE * float(np.ptp(pressure_pa)), LEAP_SIGMAS * 1.4826 * float(np.median(deviation)))
    return np.asarray((deviation > least_deviation) & (deviation > 4.0 * level_nearby))


def _span_of_counts(observation: ChamberObservation) -> Array:
    """Return the range (T, 12) of each taxel's readings, between the quantiles 0.01 and 0.99."""
    return np.asarray(np.subtract(*np.quantile(observation.activation_count, [0.99, 0.01], axis=0)))


def _agreement(observation: ChamberObservation) -> float:
    """Return the squared correlation of the taxels' trimmed mean with the load, on the observation's clock."""
    known = observation.reference.is_known(observation.reference_s)
    if known.sum() < LEAST_ROWS:
        return 0.0
    load_pa = observation.reference.at(observation.reference_s)[known, 0]
    mean_count = trim_mean(observation.activation_count[:, observation.usable], 0.25, axis=1)[known]
    return float(np.corrcoef(load_pa, mean_count)[0, 1] ** 2)


def _with_fitted_clock(recording: Recording, observation: ChamberObservation) -> ChamberObservation:
    """Return the observation on the clock on which the edges of readings and load agree."""
    try:
        clock = _edge_clock(observation)
    except CalibrationError as error:
        raise DiagnosisError(f"{recording.folder}: {error}") from error
    return replace(observation.with_clock(clock.offset_s, clock.rate), rate_std=clock.rate_std)


def _edge_clock(observation: ChamberObservation) -> Clock:
    """Return the clock on which the edges of readings and load agree; memory and temperature are fitted with it.

    The edges are those of all responsive taxels, or of one board if these fit clearly better: where a board has a step
    or a delay of its own, the others have the right times. Raises CalibrationError if no taxels follow the load.
    """
    span_count = _span_of_counts(observation)
    responds = observation.usable & (span_count > LEAST_SPAN_SHARE * np.quantile(span_count[observation.usable], 0.95))
    boards = observation.layout.identities[:, 0]
    groups = [responds, *(responds & (boards == board)[:, None] for board in np.unique(boards[responds.any(axis=1)]))]
    grid_s = np.arange(0, len(observation.reference.fine), 2, dtype=np.float64) * FINE_S
    clocks: list[Clock] = []
    for group in groups if len(groups) > 2 else groups[:1]:
        # The middle half of the taxels: a single one that leaps moves edges by seconds.
        mean = trim_mean(observation.activation_count[:, group], 0.25, axis=1)
        try:
            clocks.append(
                fit_own_clock(
                    observation.t_s,
                    mean,
                    grid_s,
                    observation.reference.fine[::2, 0],
                    memory=observation.reference.has_times,
                )
            )
        except CalibrationError as error:
            why = error
    if not clocks:
        raise why
    best_board = max(clocks[1:], key=lambda candidate: candidate.explained, default=clocks[0])
    return best_board if 1.0 - best_board.explained < LESS_UNEXPLAINED * (1.0 - clocks[0].explained) else clocks[0]
