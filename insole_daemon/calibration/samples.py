"""Align the reference with a trial's cycles, smooth both, and select the samples to fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.stats import trim_mean

from ..errors import CalibrationError
from . import clock as clocks
from .clock import Clock
from .smoothing import is_far_from, is_slow, savitzky_golay
from .trials import CalibrationTrial

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_MOSTLY_VALID, _MIN_TAXELS = 0.99, 10
_INSTANT_S = 0.5  # a median over this time removes what lasts less than half of it
_MIN_CORRELATION = 0.7  # least correlation of the taxels with the reference
_MOST_OFFSETS_S = (20.0, 5.0, 1.0)
_UNLOADED = 0.15  # fraction of the reference's range above its lowest value


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """The fitted samples of one trial."""

    trial: CalibrationTrial
    clock: Clock
    activation: Array  # (n, slots)
    valid: Mask  # (n, slots)
    reference: Array  # (n, c)
    t_s: Array  # (n,)
    covered: float  # fraction of the cycles with a reference


def usable_slots(trial: CalibrationTrial) -> Mask:
    """Return (slots,) which slots are valid most of the time."""
    is_usable: Mask = trial.valid.mean(axis=0) > 0.5
    return is_usable


def align_by_activation(trial: CalibrationTrial) -> Clock:
    """Fit the reference's clock by the movement of both streams, before any calibration exists."""
    if trial.kind == "chamber":
        mean = _mean_activation(trial)
        features = np.stack([mean, mean**2, mean**3], axis=1)
    else:
        slots = usable_slots(trial)
        a = np.where(trial.valid[:, slots], trial.activation[:, slots], 0.0)
        x, y = trial.layout.xy_m.reshape(-1, 2)[slots].T
        arms = np.stack([np.ones_like(x), y, x], axis=1)
        features = np.concatenate([a @ arms, a**2 @ arms], axis=1)
    return _fit_clock(trial, features)


def _mean_activation(trial: CalibrationTrial) -> Array:
    """Return (n,) the mean activation of the middle half of the taxels, without events shorter than 0.25 s.

    A triangle that loses contact for an instant, as in public recordings, makes edges that the pressure does not have.
    """
    is_mostly_valid = trial.valid.mean(axis=0) > _MOSTLY_VALID
    slots = is_mostly_valid if np.count_nonzero(is_mostly_valid) >= _MIN_TAXELS else usable_slots(trial)
    middle = trim_mean(trial.activation[:, slots], 0.25, axis=1)
    window = max(round(_INSTANT_S / float(np.median(np.diff(trial.t_s)))), 1)
    settled: Array = uniform_filter1d(median_filter(middle, window), window)
    return settled


def align_by_prediction(trial: CalibrationTrial, predicted: Array) -> Clock:
    """Fit the reference's clock to the wrench that a calibration predicts from the counts, (n, c)."""
    return _fit_clock(trial, predicted)


def _fit_clock(trial: CalibrationTrial, features: Array) -> Clock:
    """Fit the clock, with a smaller range of offsets if the result correlates negatively.

    In periodic cycles or steps, a shift by half a period fits equally well with the opposite sign.
    """
    readings = trial.readings
    for most_offset_s in _MOST_OFFSETS_S:
        try:
            clock = clocks.fit_clock(trial.t_s, features, readings.t_s, readings.values, most_offset_s=most_offset_s)
        except CalibrationError as error:
            raise CalibrationError(f"{trial.name}: {error}") from error
        correlation = _correlation(trial, clock)
        if correlation >= _MIN_CORRELATION:
            return clock
    raise CalibrationError(
        f"{trial.name}: the {'pressure' if trial.kind == 'chamber' else 'force'} of the reference does not grow with "
        f"what the {trial.foot.foot} insole reads (correlation {correlation:.2f}): is it that of the other foot?"
    )


def _correlation(trial: CalibrationTrial, clock: Clock) -> float:
    """Return the correlation of the total activation with the pressure, or the force, of the reference."""
    reference = reference_at_cycles(trial, clock)[:, 0]
    is_finite = np.isfinite(reference)
    slots = usable_slots(trial)
    total_activation = np.where(trial.valid[:, slots], trial.activation[:, slots], 0.0).sum(axis=1)
    return float(np.corrcoef(total_activation[is_finite], reference[is_finite])[0, 1])


def reference_at_cycles(trial: CalibrationTrial, clock: Clock) -> Array:
    """Return (n, c) the reference at the cycles; NaN where it has no readings."""
    times_s = clock.reference_s(trial.t_s)
    readings = trial.readings
    is_finite = np.isfinite(readings.values).all(axis=1)
    t_s = readings.t_s[is_finite]
    values = np.stack([np.interp(times_s, t_s, column[is_finite]) for column in readings.values.T], axis=1)
    # Interpolate over a few missing readings, but not over a pause.
    after = np.clip(np.searchsorted(t_s, times_s), 1, len(t_s) - 1)
    is_bridged = t_s[after] - t_s[after - 1] < max(0.2, 3 * float(np.median(np.diff(t_s))))
    values[(times_s < t_s[0]) | (times_s > t_s[-1]) | ~is_bridged] = np.nan
    return values


def select_samples(trial: CalibrationTrial, clock: Clock) -> Samples:
    """Smooth a trial and select its slow samples; CalibrationError if the reference contradicts the taxels."""
    reference = reference_at_cycles(trial, clock)
    has_reference: Mask = np.asarray(np.isfinite(reference).all(axis=1))
    _check_start(trial, reference[:, 0])
    if trial.kind == "shoe":
        _check_foot(trial, reference, has_reference)
    smooth = savitzky_golay(np.where(has_reference[:, None], reference, 0.0), trial.t_s)
    smooth[~is_far_from(~has_reference)] = np.nan
    is_selected = is_slow(smooth, trial.t_s)
    activation = savitzky_golay(trial.activation, trial.t_s)[is_selected]
    valid = is_far_from(~trial.valid)[is_selected]
    return Samples(
        trial, clock, activation, valid, smooth[is_selected], trial.t_s[is_selected], float(has_reference.mean())
    )


def _check_start(trial: CalibrationTrial, load: Array) -> None:
    """Raise CalibrationError if the reference (n,) shows a load at the start, on which the trial is zeroed."""
    start = load[: trial.rest_cycles]
    low, high = np.nanpercentile(load, (1, 99)).tolist()
    if np.isfinite(start).any() and np.nanmean(start) > low + _UNLOADED * (high - low):
        unit = "Pa" if trial.kind == "chamber" else "N"
        raise CalibrationError(
            f"{trial.name}: expected no load at its start, on which it is zeroed, found {np.nanmean(start):.3g} of "
            f"{high:.3g} {unit} on the reference: record from before the load begins"
        )


def _check_foot(trial: CalibrationTrial, reference: Array, has_reference: Mask) -> None:
    """Raise CalibrationError if the reference's moments contradict the distribution of the activation."""
    slots = usable_slots(trial)
    a = np.where(trial.valid[:, slots], trial.activation[:, slots], 0.0)[has_reference]
    x, y = trial.layout.xy_m.reshape(-1, 2)[slots].T
    moments = np.stack([a @ y, -(a @ x)], axis=1)
    wrench = reference[has_reference, 1:]
    correlations = [float(np.corrcoef(moments[:, i], wrench[:, i])[0, 1]) for i in (0, 1)]
    sides = {"m_x": correlations[0], "m_y": correlations[1]}
    opposite = [name for name, value in sides.items() if value < -_MIN_CORRELATION]
    if opposite:
        raise CalibrationError(
            f"{trial.name}: the sign of the reference's {' and '.join(opposite)} is opposite to what the "
            f"{trial.foot.foot} insole reads: is it the reference of the other foot, or are its moments about "
            "another origin, or are its axes other than x forward, y to the wearer's left, z up?"
        )
