"""A recording whose load is known on every taxel: pressures by triangle and the reference pressure, on one time grid.

Where the load is the same everywhere, a triangle's taxels say the same thing ten times over; their mean, weighted by
what each knows, is what the regression sees. The reference stands for the load of every triangle.
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
from .alignment import FAR_S, fit_own_clock
from .wrench import (
    FINE_S,
    JITTER_S,
    LEAST_LAG_S,
    LEAST_ROWS,
    TEMPERATURE,
    ReferenceWrench,
    WrenchObservation,
    read_rows,
    row_times,
)  # fmt: skip

LEAST_RISE_PA = 1e4  # by which the pressure varies
SMOOTH_S, SMOOTH_ROWS, DEGREE = 0.06, 3, 3  # half the window of the reference
NOISE_KEPT = 2.25  # of a cubic fit over many rows, times their number (Savitzky & Golay)
N_TABLE = 400  # of the curves, to be read backwards
BENT = 0.5  # of the time between two readings
LEAP_S, LEAP_SHARE, LEAP_SIGMAS = 0.05, 0.02, 20.0  # of the range; of what rows are off their neighbours
LEAST_ANSWER = 0.2  # of the span of the liveliest taxels: less, and a taxel tells little of the load
LEAST_SPAN_COUNT = 2.0  # of the taxel that answers most
CLEARER = 0.85  # of what the edges of all taxels leave unexplained, that those of one board may leave
LEAST_AGREEMENT = 0.8  # with the load on a declared clock: less, and the clock may be far off
LEAST_TOLD = 0.3  # of the readings' time, that the reference covers


@dataclass(frozen=True, eq=False)
class ChamberObservation(WrenchObservation):
    """One foot of one recording in a chamber or a bag: channels are the T triangles' mean pressures, Pa.

    `lag_s`: of a first-order lag through which taxels see the load.
    """

    lag_s: float = 0.0
    settled: frozenset[tuple[str, str]] = frozenset()  # effects and scopes already found or ruled out: not searched

    load_is_known = True
    is_uniform = True

    @cached_property
    def arms(self) -> Array:
        """(T, 12, 1) weights of the taxels in their triangle's mean, by what a reading of each says; they sum to 1."""
        slope = np.mean(self.slope_pa, axis=0)
        known = np.where(self.usable, 1.0 / np.maximum(slope * np.maximum(self.noise_count, 0.1), 1e-9) ** 2, 0.0)
        return np.asarray((known / np.maximum(known.sum(axis=1, keepdims=True), 1e-300))[..., None])

    @property
    def least_lag_s(self) -> float:
        """As of a wrench; on a clock of its own a lag only bends edges, and readings are too far apart to show that."""
        period_s = float(np.median(self.period_s[np.isfinite(self.period_s)]))
        return max(LEAST_LAG_S, BENT * period_s) if self.offset_is_free else LEAST_LAG_S

    @cached_property
    def edge_delay_s(self) -> float:
        """By how much the edges of the readings are later than those of the load, with memory and warmth beside them.

        At the middle of the recording; 0 where the edges do not tell.
        """
        try:
            clock = _edge_clock(self)
        except CalibrationError:
            return 0.0
        middle_s = np.array([(self.t_s[0] + self.t_s[-1]) / 2])
        return float(self.offset_s + middle_s[0] - clock.reference_s(middle_s)[0])

    def load_pa(self, at_s: Array) -> Array:
        """(n, 1, 1) pressure on every taxel at times (n,) of the reference's clock."""
        return self.reference.smooth_at(at_s, self.lag_s)[:, :, None]

    @cached_property
    def expected_count(self) -> Array:
        """(N, T, 12) activation by the static curves under the load of the reference."""
        return self.activation_at(self.reference.at(self.reference_s, self.lag_s)[:, :, None])

    def activation_at(self, pressure_pa: Array) -> Array:
        """(N, T, 12) by the static curves under pressures that broadcast to it; below no load, straight on."""
        lowest = min(float(self.activation_count.min()), 0.0) - 5.0
        grid = np.linspace(lowest, float(self.activation_count.max()) + 5.0, N_TABLE)
        shape = (N_TABLE, *self.usable.shape)
        pressure = np.maximum.accumulate(self.static_pa(np.broadcast_to(grid[:, None, None], shape)), axis=0)
        found = np.zeros(self.activation_count.shape)
        every = np.broadcast_to(pressure_pa, found.shape)
        for t, k in np.argwhere(self.usable).tolist():
            found[:, t, k] = np.interp(every[:, t, k], pressure[:, t, k], grid)
        return found

    def load_less(self, moved_pa: Array, apart_pa: Array | float = 0.0) -> Array:
        """(N, T, 12) load of every taxel at its rows, less what its triangle is moved by (N, T), and what it is itself.

        `apart_pa` (N, T, 12): by which taxels are moved more than their triangle.
        """
        return np.asarray((self.reference.at(self.reference_s) - moved_pa)[:, :, None] - apart_pa)

    @cached_property
    def counting_variance(self) -> Array:
        """(N, T, 1) variance of each triangle's mean pressure by the noise of its readings."""
        return self.variance_of((self.slope_at(self.expected_count) * self.noise_count) ** 2)

    @property
    def wrench(self) -> Array:
        """(N, T) mean pressure of each triangle by the static curves."""
        return np.asarray(self.by_triangle[..., 0])

    @cached_property
    def weight_variance(self) -> Array:
        """(N, T) variance of a row that counting noise, stamps, the reference and gaps make, Pa²."""
        counted = self.counting_variance[..., 0]
        slope = self.reference.slope(self.reference_s)
        found = counted + self.reference.noise**2 + (JITTER_S * slope) ** 2
        found = np.where(self.missing | ~self.usable.any(axis=1), np.inf, found)
        found[self.clipped | self.saturated] = np.inf
        found[~self.reference.is_known(self.reference_s)] = np.inf
        return np.asarray(found)


def observe_chamber(recording: Recording, foot: FootRecording, calibration: Calibration) -> ChamberObservation:
    """What is looked at of `foot` under the pressure that its reference tells for all taxels.

    DiagnosisError where the reference tells nothing of it.
    """
    reference = foot.reference
    if reference is None:
        raise DiagnosisError(f"{recording.folder}: expected the pressure of a {recording.kind}, found no reference")
    rows = read_rows(recording, foot, calibration, np.median)
    load = _reference(recording, foot, reference)
    declared = foot.t_ns[0] * 1e-9 - load.start_s if load.has_times and load.clock == "can" else None
    found = ChamberObservation(
        recording.folder.name, foot.layout, calibration, rows.t_s, rows.period_s, rows.activation_count, rows.usable,
        rows.missing, rows.noise_count, load, declared or 0.0, 0.0, declared, declared is None, declared is None, None,
        rows.readings,
    )  # fmt: skip
    if not np.max(_span_count(found), where=found.usable, initial=0.0) > LEAST_SPAN_COUNT:
        raise DiagnosisError(f"{recording.folder}: no taxel answers the pressure: was the insole in the chamber?")
    if declared is None:
        found = _aligned(recording, found)
    elif (agrees := _agreement(found)) < LEAST_AGREEMENT:
        moved = _aligned(recording, found)
        if abs(moved.offset_s - declared) > FAR_S and 1.0 - _agreement(moved) < CLEARER * (1.0 - agrees):
            found = replace(moved, offset_is_free=True)
    told = float(load.is_known(found.reference_s).mean())
    if told < LEAST_TOLD:
        raise DiagnosisError(
            f"{recording.folder}: the reference covers {told:.0%} of the readings, expected at least "
            f"{LEAST_TOLD:.0%}: is it of the same trial, and did it run all the time?"
        )
    if TEMPERATURE in reference.columns:
        values = reference[TEMPERATURE]
        known = np.isfinite(values)
        if known.any():
            times_s = row_times(foot, reference.time_s, len(values)) - load.start_s
            found = replace(found, temperature_c=np.interp(found.reference_s, times_s[known], values[known]))
    return found


def _reference(recording: Recording, foot: FootRecording, reference: Reference) -> ReferenceWrench:
    """The pressure on a fine grid, (M, 1)."""
    pressure = reference["pressure_pa"]
    time_s = row_times(foot, reference.time_s, len(pressure))
    good = np.isfinite(pressure) & (np.diff(time_s, prepend=-np.inf) > 0)
    rises = float(np.ptp(pressure[good])) if good.any() else 0.0
    if good.sum() < LEAST_ROWS or not rises > LEAST_RISE_PA:
        raise DiagnosisError(
            f"{recording.folder}: the pressure of the reference stays within {rises / 1e3:.1f} kPa, expected one that "
            f"rises and falls by more than {LEAST_RISE_PA / 1e3:.0f} kPa: was the chamber recorded?"
        )
    leaping = np.zeros(len(good), bool)
    leaping[good] = _leaps(time_s[good], pressure[good])
    leaps_s = tuple(
        (float(time_s[a] - time_s[good][0]), float(time_s[b] - time_s[good][0])) for a, b in stretches(leaping)
    )
    good &= ~leaping
    t, p = time_s[good] - time_s[good][0], pressure[good][:, None]
    grid_s = np.arange(0.0, t[-1], FINE_S)
    after = np.searchsorted(t, grid_s, side="right").clip(1, len(t) - 1)
    row_s = float(np.median(np.diff(t)))
    rows = 2 * max(round(SMOOTH_S / row_s), SMOOTH_ROWS) + 1
    known = t[after] - t[after - 1] < max(0.25, 3.0 * row_s)
    noise = np.median(np.abs(np.diff(p, n=3, axis=0)), axis=0) / np.sqrt(20.0) / 0.6745
    # Cubics: a mean would be a memory itself, symmetric in time.
    window = 2 * round(rows * row_s / FINE_S / 2) + 1
    fine = savgol_filter(CubicSpline(t, p)(grid_s), window, DEGREE, axis=0)
    noise = noise * np.sqrt(NOISE_KEPT / rows)
    return ReferenceWrench(
        float(time_s[good][0]), fine, known, noise, reference.clock,
        reference.time_s is not None, row_s, leaps_s,
    )  # fmt: skip


def _leaps(time_s: Array, pressure_pa: Array) -> NDArray[np.bool_]:
    """(n,) rows away from those before and after for less than any pressure could be, LEAP_S.

    Where a pressure turns round, the straight lines of both sides lead to it.
    """
    row_s = float(np.median(np.diff(time_s)))
    half = max(round(LEAP_S / row_s), 1)
    width, row = 2 * half + 1, np.arange(len(pressure_pa))
    foretold = [median_filter(pressure_pa, width, mode="nearest")]
    for side in (-half, half):
        near, far = (pressure_pa[np.clip(row + k * side, 0, len(row) - 1)] for k in (1, 2))
        foretold.append(2.0 * near - far)
    away = np.min(np.abs(pressure_pa - np.stack(foretold)), axis=0)
    usual = percentile_filter(away, 90, 8 * width + 1)
    least = max(LEAP_SHARE * float(np.ptp(pressure_pa)), LEAP_SIGMAS * 1.4826 * float(np.median(away)))
    return np.asarray((away > least) & (away > 4.0 * usual))


def _span_count(found: ChamberObservation) -> Array:
    """(T, 12) of the readings."""
    return np.asarray(np.subtract(*np.quantile(found.activation_count, [0.99, 0.01], axis=0)))


def _agreement(found: ChamberObservation) -> float:
    """Square of the correlation between a middle taxel's readings and the load, on the clock as it is."""
    known = found.reference.is_known(found.reference_s)
    if known.sum() < LEAST_ROWS:
        return 0.0
    said = found.reference.at(found.reference_s)[known, 0]
    read = trim_mean(found.activation_count[:, found.usable], 0.25, axis=1)[known]
    return float(np.corrcoef(said, read)[0, 1] ** 2)


def _aligned(recording: Recording, found: ChamberObservation) -> ChamberObservation:
    """On the clock by which the edges agree."""
    try:
        fitted = _edge_clock(found)
    except CalibrationError as error:
        raise DiagnosisError(f"{recording.folder}: {error}") from error
    return replace(found.with_clock(fitted.offset_s, fitted.rate), rate_std=fitted.rate_std)


def _edge_clock(found: ChamberObservation) -> Clock:
    """The clock by which the edges agree, with what memory and warmth do to readings fitted beside it.

    Of the taxels that answer the load, all together or those of one board: where a board steps or is late by itself,
    the others say when it was. CalibrationError where no group of taxels follows the load.
    """
    span = _span_count(found)
    answers = found.usable & (span > LEAST_ANSWER * np.quantile(span[found.usable], 0.95))
    boards = found.layout.identities[:, 0]
    groups = [answers, *(answers & (boards == board)[:, None] for board in np.unique(boards[answers.any(axis=1)]))]
    at_s = np.arange(0, len(found.reference.fine), 2, dtype=np.float64) * FINE_S
    every: list[Clock] = []
    for group in groups if len(groups) > 2 else groups[:1]:
        # The middle half of the taxels: one that leaps bends edges by seconds.
        mean = trim_mean(found.activation_count[:, group], 0.25, axis=1)
        try:
            every.append(
                fit_own_clock(found.t_s, mean, at_s, found.reference.fine[::2, 0], memory=found.reference.has_times)
            )
        except CalibrationError as error:
            why = error
    if not every:
        raise why
    best = max(every[1:], key=lambda each: each.explained, default=every[0])
    return best if 1.0 - best.explained < CLEARER * (1.0 - every[0].explained) else every[0]
