"""A walk with a force shoe or plate, from its files: readings and reference, on clocks by whose edges they agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from ...calibration import clock as clocks
from ...errors import CalibrationError, DiagnosisError
from ...physics.calibration import Calibration
from ...recording.loading import FootRecording, Recording
from .alignment import FAR_S
from .rezeros import with_rezeros
from .wrench import CHANNELS, FINE_S, LEAST_ROWS, TEMPERATURE, ReferenceWrench, WrenchObservation, read_rows, row_times

LEAST_FORCE_N = 50.0  # by which the reference's force varies
LEAST_CORRELATION = 0.7  # of the two forces once the clocks are aligned
CORRELATED_S, LEAST_MOVE = 8.0, 0.3  # of stretches, and of the force's range that they cover
NEAR_S = 0.05  # clocks that are off by no more are taken as declared
INDEPENDENT = 4.0  # rows that make one, of what the static model leaves


def observe_walk(recording: Recording, foot: FootRecording, calibration: Calibration) -> WrenchObservation:
    """What is looked at of `foot`; DiagnosisError where its reference tells nothing of it."""
    reference = foot.reference
    if reference is None:
        raise DiagnosisError(f"{recording.folder}: expected the wrench of a force shoe or plate, found no reference")
    rows = read_rows(recording, foot, calibration, np.max)
    wrench = _reference(recording, foot, reference)
    declared = None
    offset_s = 0.0
    if wrench.has_times and wrench.clock == "can":
        offset_s = declared = foot.t_ns[0] * 1e-9 - wrench.start_s
    found = WrenchObservation(
        recording.folder.name, foot.layout, calibration, rows.t_s, rows.period_s, rows.activation_count, rows.usable,
        rows.missing, rows.noise_count, wrench, offset_s, 0.0, declared, declared is None, False, None, rows.readings,
    )  # fmt: skip
    # A board that was zeroed under a foot bends every edge from then on.
    right = _aligned(with_rezeros(foot, found)[0])
    found = replace(
        found, offset_s=right.offset_s, rate=right.rate, rate_std=right.rate_std, offset_is_free=right.offset_is_free,
        rate_is_free=right.rate_is_free,
    )  # fmt: skip
    if TEMPERATURE in reference.columns:
        values = reference[TEMPERATURE]
        known = np.isfinite(values)
        if known.any():
            times_s = row_times(foot, reference.time_s, len(values)) - wrench.start_s
            found = replace(found, temperature_c=np.interp(found.reference_s, times_s[known], values[known]))
    return found


def _reference(recording: Recording, foot: FootRecording, reference: object) -> ReferenceWrench:
    """The reference on its fine grid."""
    assert foot.reference is not None
    values = np.stack([foot.reference[name] for name in CHANNELS], axis=1)
    time_s = row_times(foot, foot.reference.time_s, len(values))
    good = np.isfinite(values).all(axis=1) & (np.diff(time_s, prepend=-np.inf) > 0)
    force = values[good, 0]
    moved = float(np.ptp(force)) if force.size else 0.0
    if len(force) < LEAST_ROWS or not moved > LEAST_FORCE_N:
        raise DiagnosisError(
            f"{recording.folder}: the force of the reference stays within {moved:.0f} N, "
            f"expected one that rises and falls by more than {LEAST_FORCE_N:.0f} N: was the shoe recorded?"
        )
    t, w = time_s[good] - time_s[good][0], values[good]
    grid_s = np.arange(0.0, t[-1], FINE_S)
    after = np.searchsorted(t, grid_s, side="right").clip(1, len(t) - 1)
    known = t[after] - t[after - 1] < max(0.1, 3.0 * float(np.median(np.diff(t))))
    third = np.abs(np.diff(w, n=3, axis=0)) / np.sqrt(20.0)
    return ReferenceWrench(
        float(time_s[good][0]), CubicSpline(t, w)(grid_s), known, np.median(third, axis=0) / 0.6745,
        foot.reference.clock, foot.reference.time_s is not None, float(np.median(np.diff(t))),
    )  # fmt: skip


def _aligned(found: WrenchObservation) -> WrenchObservation:
    """The clock by which the edges agree.

    A declared CAN clock, and a rate of 1, are kept as long as they are near: what is then left is for the terms
    `clock` and `delay` to explain. A clock that is far off is taken as the edges show it.
    """
    reference, every = found.reference, 2
    agrees = -1.0
    for most_s in (20.0, 5.0, 1.0):
        try:
            at_s = np.arange(0, len(reference.fine), every, dtype=np.float64) * FINE_S
            fitted = clocks.fit_clock(
                found.t_s, found.wrench, at_s, reference.fine[::every],
                most_offset_s=most_s + (abs(found.offset_s) if found.declared_offset_s is not None else 0.0),
            )  # fmt: skip
        except CalibrationError as error:
            raise DiagnosisError(f"{found.name}: {error}") from error
        moved = found.with_clock(fitted.offset_s, fitted.rate)
        agrees = _correlation(moved)
        if agrees > LEAST_CORRELATION:
            break
    middle_s, half_s = float(found.t_s.mean()), float(np.ptp(found.t_s)) / 2
    near = abs(fitted.rate) * half_s < NEAR_S
    declared = found.declared_offset_s
    if declared is not None and near and abs(fitted.offset_s - declared + fitted.rate * middle_s) < FAR_S:
        return found
    if agrees <= LEAST_CORRELATION:
        if declared is not None and _correlation(found) > LEAST_CORRELATION:
            return found
        raise DiagnosisError(
            f"{found.name}: the force of the reference does not grow with what the {found.layout.foot} insole "
            f"reads (correlation {agrees:.2f}): is it that of the other foot?"
        )
    if near:
        moved = found.with_clock(fitted.offset_s + fitted.rate * middle_s, 0.0)
    return replace(_refined_clock(moved, rate_is_free=not near), offset_is_free=True, rate_is_free=not near)


def _refined_clock(found: WrenchObservation, rate_is_free: bool) -> WrenchObservation:
    """Gauss-Newton on the residual of the static model, with its scale, offset and rate free."""
    away_s = found.t_s - found.t_s.mean()
    for _ in range(6):
        said = found.reference.at(found.reference_s)
        weights = np.where(np.isfinite(found.weight_variance), found.weight_variance, np.inf) ** -0.5
        slope = found.reference.slope(found.reference_s)
        columns = [found.wrench, slope, *([slope * away_s[:, None]] if rate_is_free else [])]
        x = np.stack([(column * weights).ravel() for column in columns], axis=1)
        y = (said * weights).ravel()
        shares = np.linalg.lstsq(x, y, rcond=None)[0]
        left = np.abs(y - x @ shares)
        robust = 1.0 / np.maximum(1.0, left / (4.0 * float(np.median(left[left > 0])) + 1e-12))
        shares = np.linalg.lstsq(x * robust[:, None], y * robust, rcond=None)[0]
        # reference(t + shift) ≈ reference(t) + slope·shift should be the insole's.
        rate = -float(shares[2]) if rate_is_free else 0.0
        rest = float(np.mean(((y - x @ shares) * robust) ** 2))
        rate_std = float(np.sqrt(INDEPENDENT * rest * np.linalg.inv(x.T @ x)[2, 2])) if rate_is_free else 0.0
        shift_s = -float(shares[1]) - rate * float(found.t_s.mean())
        found = replace(found.with_clock(found.offset_s + shift_s, found.rate + rate), rate_std=rate_std)
        if abs(shares[1]) < 1e-5 and abs(rate) * float(np.ptp(found.t_s)) < 1e-5:
            break
    return found


def _correlation(found: WrenchObservation) -> float:
    """Of the two forces: the median over stretches in which the foot is loaded and lifted, one of which may be loud."""
    known = found.reference.is_known(found.reference_s)
    if known.mean() < 0.3:
        return -1.0
    said, read = found.reference.at(found.reference_s)[:, 0], found.wrench[:, 0]
    size = max(round(CORRELATED_S / found.step_s), LEAST_ROWS)
    moves = LEAST_MOVE * float(np.ptp(said[known]))
    every = []
    for start in range(0, len(said), size):
        rows = np.flatnonzero(known[start : start + size]) + start
        if len(rows) > size // 2 and np.ptp(said[rows]) > moves and np.ptp(read[rows]) > 0:
            every.append(float(np.corrcoef(said[rows], read[rows])[0, 1]))
    return float(np.median(every)) if every else float(np.corrcoef(said[known], read[known])[0, 1])
