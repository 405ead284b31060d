"""Observe a walk with a force shoe or plate: readings and reference wrench, with their clocks aligned by edges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from ...calibration import clock as clocks
from ...calibration.clock import Clock
from ...errors import CalibrationError, DiagnosisError
from ...physics.calibration import Calibration
from ...recording.loading import FootRecording, Recording
from ...recording.reference import Reference
from .alignment import MOST_CLOCK_ERROR_S
from .grid_readings import LEAST_ROWS, read_rows, row_times, temperature_at
from .reference_wrench import FINE_S, ReferenceWrench, fine_grid
from .rezeros import correct_rezeros
from .wrench import CHANNELS, WrenchObservation

MOST_OFFSETS_S = (20.0, 5.0, 1.0)  # of the clock, tried in turn until the forces correlate
LEAST_FORCE_N = 50.0  # smallest range of the reference's force
LEAST_CORRELATION = 0.7  # of both forces on aligned clocks
STRETCH_S, LEAST_RANGE = 8.0, 0.3  # of a correlation; share of the force's range that the stretch has to have
DECLARED_NEAR_S = 0.05  # deviation up to which a declared clock is used
ROWS_PER_INDEPENDENT = 4.0  # autocorrelation of the static model's residual, in rows


def observe_walk(recording: Recording, foot: FootRecording, calibration: Calibration) -> WrenchObservation:
    """Return the observation of `foot`; raises DiagnosisError if its reference is missing or not usable."""
    reference = foot.reference
    if reference is None:
        raise DiagnosisError(f"{recording.folder}: expected the wrench of a force shoe or plate, found no reference")
    rows = read_rows(recording, foot, calibration, np.max)
    wrench = _reference(recording, foot, reference)
    declared_offset_s = None
    offset_s = 0.0
    if wrench.has_times and wrench.clock == "can":
        offset_s = declared_offset_s = foot.t_ns[0] * 1e-9 - wrench.start_s
    observation = WrenchObservation(
        name=recording.folder.name, layout=foot.layout, calibration=calibration, t_s=rows.t_s, period_s=rows.period_s,
        activation_count=rows.activation_count, usable=rows.usable, missing=rows.missing, noise_count=rows.noise_count,
        reference=wrench, offset_s=offset_s, rate=0.0, declared_offset_s=declared_offset_s,
        offset_is_free=declared_offset_s is None, rate_is_free=False, temperature_c=None, readings=rows.readings,
    )  # fmt: skip
    # A re-zero under load changes all later edges, so the clock is fitted to corrected readings.
    aligned = _with_fitted_clock(correct_rezeros(foot, observation)[0])
    observation = replace(
        observation, offset_s=aligned.offset_s, rate=aligned.rate, rate_std=aligned.rate_std,
        offset_is_free=aligned.offset_is_free, rate_is_free=aligned.rate_is_free,
    )  # fmt: skip
    return replace(observation, temperature_c=temperature_at(foot, wrench.start_s, observation.reference_s))


def _reference(recording: Recording, foot: FootRecording, reference: Reference) -> ReferenceWrench:
    """Return the reference on its fine grid."""
    values = np.stack([reference[name] for name in CHANNELS], axis=1)
    time_s = row_times(foot, reference.time_s, len(values))
    is_good = np.isfinite(values).all(axis=1) & (np.diff(time_s, prepend=-np.inf) > 0)
    force = values[is_good, 0]
    range_n = float(np.ptp(force)) if force.size else 0.0
    if len(force) < LEAST_ROWS or not range_n > LEAST_FORCE_N:
        raise DiagnosisError(
            f"{recording.folder}: the force of the reference stays within {range_n:.0f} N, "
            f"expected one that rises and falls by more than {LEAST_FORCE_N:.0f} N: was the shoe recorded?"
        )
    row_time_s, row_wrench = time_s[is_good] - time_s[is_good][0], values[is_good]
    grid_s = fine_grid(recording.folder, row_time_s)
    after = np.searchsorted(row_time_s, grid_s, side="right").clip(1, len(row_time_s) - 1)
    known = row_time_s[after] - row_time_s[after - 1] < max(0.1, 3.0 * float(np.median(np.diff(row_time_s))))
    third_difference = np.abs(np.diff(row_wrench, n=3, axis=0)) / np.sqrt(20.0)
    return ReferenceWrench(
        float(time_s[is_good][0]), CubicSpline(row_time_s, row_wrench)(grid_s), known,
        np.median(third_difference, axis=0) / 0.6745, reference.clock, reference.time_s is not None,
        float(np.median(np.diff(row_time_s))),
    )  # fmt: skip


def _with_fitted_clock(observation: WrenchObservation) -> WrenchObservation:
    """Return the observation on the clock on which the edges of both forces agree.

    A declared CAN clock and a rate of 1 are kept if they are near: the terms `clock` and `delay` explain the rest.
    """
    declared_s = observation.declared_offset_s
    for most_offset_s in MOST_OFFSETS_S:
        fitted = _fit_clock(observation, most_offset_s + (0.0 if declared_s is None else abs(observation.offset_s)))
        realigned = observation.with_clock(fitted.offset_s, fitted.rate)
        correlation = _force_correlation(realigned)
        if correlation > LEAST_CORRELATION:
            break
    mid_s, half_s = float(observation.t_s.mean()), float(np.ptp(observation.t_s)) / 2
    is_rate_near = abs(fitted.rate) * half_s < DECLARED_NEAR_S
    if (
        declared_s is not None
        and is_rate_near
        and abs(fitted.offset_s - declared_s + fitted.rate * mid_s) < MOST_CLOCK_ERROR_S
    ):
        return observation
    if correlation <= LEAST_CORRELATION:
        if declared_s is not None and _force_correlation(observation) > LEAST_CORRELATION:
            return observation
        raise DiagnosisError(
            f"{observation.name}: the force of the reference does not grow with what the {observation.layout.foot} "
            f"insole reads (correlation {correlation:.2f}): is it that of the other foot?"
        )
    if is_rate_near:
        realigned = observation.with_clock(fitted.offset_s + fitted.rate * mid_s, 0.0)
    return replace(
        _with_refined_clock(realigned, rate_is_free=not is_rate_near),
        offset_is_free=True,
        rate_is_free=not is_rate_near,
    )


def _fit_clock(observation: WrenchObservation, most_offset_s: float) -> Clock:
    """Return the clock on which the edges of both wrenches agree best; every other row of the fine grid is used."""
    fine = observation.reference.fine[::2]
    fine_s = np.arange(len(fine), dtype=np.float64) * 2 * FINE_S
    try:
        return clocks.fit_clock(observation.t_s, observation.wrench, fine_s, fine, most_offset_s=most_offset_s)
    except CalibrationError as error:
        raise DiagnosisError(f"{observation.name}: {error}") from error


def _with_refined_clock(observation: WrenchObservation, rate_is_free: bool) -> WrenchObservation:
    """Return the observation with offset and rate by Gauss-Newton on the residual of the static model.

    The scale of the wrench is free, too; rows with large residuals get smaller weights.
    """
    centred_s = observation.t_s - observation.t_s.mean()
    for _ in range(6):
        wrench_of_reference = observation.reference.at(observation.reference_s)
        weights = np.where(np.isfinite(observation.weight_variance), observation.weight_variance, np.inf) ** -0.5
        slope = observation.reference.slope(observation.reference_s)
        columns = [observation.wrench, slope, *([slope * centred_s[:, None]] if rate_is_free else [])]
        design = np.stack([(column * weights).ravel() for column in columns], axis=1)
        target = (wrench_of_reference * weights).ravel()
        coefficients = np.linalg.lstsq(design, target, rcond=None)[0]
        absolute_residual = np.abs(target - design @ coefficients)
        robust = 1.0 / np.maximum(
            1.0, absolute_residual / (4.0 * float(np.median(absolute_residual[absolute_residual > 0])) + 1e-12)
        )
        coefficients = np.linalg.lstsq(design * robust[:, None], target * robust, rcond=None)[0]
        # Linearised: reference(t + shift) ≈ reference(t) + slope·shift.
        rate = -float(coefficients[2]) if rate_is_free else 0.0
        residual_variance = float(np.mean(((target - design @ coefficients) * robust) ** 2))
        rate_std = (
            float(np.sqrt(ROWS_PER_INDEPENDENT * residual_variance * np.linalg.inv(design.T @ design)[2, 2]))
            if rate_is_free
            else 0.0
        )
        shift_s = -float(coefficients[1]) - rate * float(observation.t_s.mean())
        observation = replace(
            observation.with_clock(observation.offset_s + shift_s, observation.rate + rate), rate_std=rate_std
        )
        if abs(coefficients[1]) < 1e-5 and abs(rate) * float(np.ptp(observation.t_s)) < 1e-5:
            break
    return observation


def _force_correlation(observation: WrenchObservation) -> float:
    """Return the correlation of both forces: the median over stretches with stance and swing, or −1 if unknown.

    The median is robust against a single noisy stretch.
    """
    known = observation.reference.is_known(observation.reference_s)
    if known.mean() < 0.3:
        return -1.0
    reference_n, insole_n = observation.reference.at(observation.reference_s)[:, 0], observation.wrench[:, 0]
    stretch_rows = max(round(STRETCH_S / observation.step_s), LEAST_ROWS)
    least_range_n = LEAST_RANGE * float(np.ptp(reference_n[known]))
    correlations = []
    for start in range(0, len(reference_n), stretch_rows):
        rows = np.flatnonzero(known[start : start + stretch_rows]) + start
        if len(rows) > stretch_rows // 2 and np.ptp(reference_n[rows]) > least_range_n and np.ptp(insole_n[rows]) > 0:
            correlations.append(float(np.corrcoef(reference_n[rows], insole_n[rows])[0, 1]))
    return (
        float(np.median(correlations))
        if correlations
        else float(np.corrcoef(reference_n[known], insole_n[known])[0, 1])
    )
