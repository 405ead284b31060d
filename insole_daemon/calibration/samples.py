"""A trial's cycles beside what its reference said at the same moments, smoothed and selected: what is fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.stats import trim_mean

from ..errors import CalibrationError
from . import clock as clocks
from .clock import Clock
from .smoothing import far_from, savitzky_golay, slow
from .trials import CalibrationTrial

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_ALWAYS, _ENOUGH = 0.99, 10
_INSTANT_S = 0.5  # a median over it keeps what lasts longer than half of that
_AGREES = 0.7  # correlation of the taxels with the reference
_MOST_OFFSETS_S = (20.0, 5.0, 1.0)
_UNLOADED = 0.15  # of the reference's range, above its lowest


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """The rows of one trial that are fitted; block: a number that grows along the trial, for cross-validation."""

    trial: CalibrationTrial
    clock: Clock
    activation: Array  # (n, slots)
    valid: Mask  # (n, slots)
    reference: Array  # (n, c)
    t_s: Array  # (n,)
    covered: float  # share of the cycles beside which the reference said something


def usable(trial: CalibrationTrial) -> Mask:
    """(slots,) that are valid most of the time."""
    often: Mask = trial.valid.mean(axis=0) > 0.5
    return often


def aligned(trial: CalibrationTrial) -> Clock:
    """The reference's clock against the taxels', from how both move: before there is any calibration."""
    if trial.kind == "chamber":
        mean = _middle(trial)
        features = np.stack([mean, mean**2, mean**3], axis=1)
    else:
        slots = usable(trial)
        a = np.where(trial.valid[:, slots], trial.activation[:, slots], 0.0)
        x, y = trial.layout.xy_m.reshape(-1, 2)[slots].T
        arms = np.stack([np.ones_like(x), y, x], axis=1)
        features = np.concatenate([a @ arms, a**2 @ arms], axis=1)
    return _fitted(trial, features)


def _middle(trial: CalibrationTrial) -> Array:
    """(n,) what the middle half of the taxels says on average, without what lasts less than a quarter of a second.

    A triangle that loses contact for an instant, as those of public recordings do, makes edges that no pressure has.
    """
    always = trial.valid.mean(axis=0) > _ALWAYS
    slots = always if np.count_nonzero(always) >= _ENOUGH else usable(trial)
    middle = trim_mean(trial.activation[:, slots], 0.25, axis=1)
    instant = max(round(_INSTANT_S / float(np.median(np.diff(trial.t_s)))), 1)
    settled: Array = uniform_filter1d(median_filter(middle, instant), instant)
    return settled


def realigned(trial: CalibrationTrial, predicted: Array) -> Clock:
    """The clock under which the reference follows what a calibration makes of the counts, (n, c)."""
    return _fitted(trial, predicted)


def _fitted(trial: CalibrationTrial, features: Array) -> Clock:
    """Of regular cycles or steps, half a period off fits as well with the sign turned: then nearer ones are tried."""
    read = trial.readings
    for most_offset_s in _MOST_OFFSETS_S:
        try:
            clock = clocks.fit_clock(trial.t_s, features, read.t_s, read.values, most_offset_s=most_offset_s)
        except CalibrationError as error:
            raise CalibrationError(f"{trial.name}: {error}") from error
        agrees = _agrees(trial, clock)
        if agrees >= _AGREES:
            return clock
    raise CalibrationError(
        f"{trial.name}: the {'pressure' if trial.kind == 'chamber' else 'force'} of the reference does not grow with "
        f"what the {trial.foot.foot} insole reads (correlation {agrees:.2f}): is it that of the other foot?"
    )


def _agrees(trial: CalibrationTrial, clock: Clock) -> float:
    """Correlation of what all taxels say with the pressure, or the force, of the reference."""
    reference = reference_at_cycles(trial, clock)[:, 0]
    said = np.isfinite(reference)
    slots = usable(trial)
    own = np.where(trial.valid[:, slots], trial.activation[:, slots], 0.0).sum(axis=1)
    return float(np.corrcoef(own[said], reference[said])[0, 1])


def reference_at_cycles(trial: CalibrationTrial, clock: Clock) -> Array:
    """(n, c) the reference at the cycles, NaN where it said nothing."""
    wanted_s = clock.reference_s(trial.t_s)
    read = trial.readings
    there = np.isfinite(read.values).all(axis=1)
    t_s = read.t_s[there]
    values = np.stack([np.interp(wanted_s, t_s, column[there]) for column in read.values.T], axis=1)
    # A few readings that are missing are bridged, a pause is not.
    after = np.clip(np.searchsorted(t_s, wanted_s), 1, len(t_s) - 1)
    bridged = t_s[after] - t_s[after - 1] < max(0.2, 3 * float(np.median(np.diff(t_s))))
    values[(wanted_s < t_s[0]) | (wanted_s > t_s[-1]) | ~bridged] = np.nan
    return values


def samples(trial: CalibrationTrial, clock: Clock) -> Samples:
    """Smoothed and slow ones; CalibrationError where the reference follows the taxels with the wrong sign."""
    reference = reference_at_cycles(trial, clock)
    said: Mask = np.asarray(np.isfinite(reference).all(axis=1))
    _check_start(trial, reference[:, 0])
    if trial.kind == "shoe":
        _check_foot(trial, reference, said)
    smooth = savitzky_golay(np.where(said[:, None], reference, 0.0), trial.t_s)
    smooth[~far_from(~said)] = np.nan
    kept = slow(smooth, trial.t_s)
    activation = savitzky_golay(trial.activation, trial.t_s)[kept]
    valid = far_from(~trial.valid)[kept]
    return Samples(trial, clock, activation, valid, smooth[kept], trial.t_s[kept], float(said.mean()))


def _check_start(trial: CalibrationTrial, load: Array) -> None:
    """Raise where the reference (n,) says that something pressed on what the trial is zeroed on."""
    start = load[: trial.rest_cycles]
    low, high = np.nanpercentile(load, (1, 99)).tolist()
    if np.isfinite(start).any() and np.nanmean(start) > low + _UNLOADED * (high - low):
        unit = "Pa" if trial.kind == "chamber" else "N"
        raise CalibrationError(
            f"{trial.name}: expected no load at its start, on which it is zeroed, found {np.nanmean(start):.3g} of "
            f"{high:.3g} {unit} on the reference: record from before the load begins"
        )


def _check_foot(trial: CalibrationTrial, reference: Array, said: Mask) -> None:
    """Raise where the reference's moments contradict where the insole is pressed."""
    slots = usable(trial)
    a = np.where(trial.valid[:, slots], trial.activation[:, slots], 0.0)[said]
    x, y = trial.layout.xy_m.reshape(-1, 2)[slots].T
    own = np.stack([a @ y, -(a @ x)], axis=1)
    wrench = reference[said, 1:]
    agrees = [float(np.corrcoef(own[:, i], wrench[:, i])[0, 1]) for i in (0, 1)]
    sides = {"m_x": agrees[0], "m_y": agrees[1]}
    contrary = [name for name, value in sides.items() if value < -_AGREES]
    if contrary:
        raise CalibrationError(
            f"{trial.name}: {' and '.join(contrary)} of the reference turn against what the {trial.foot.foot} insole "
            "reads: is it the reference of the other foot, or are its moments about another origin, or axes that "
            "point elsewhere than x forward, y to the wearer's left, z up?"
        )
