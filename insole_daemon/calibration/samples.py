"""A trial's cycles beside what its reference said at the same moments, smoothed and selected: what is fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from . import clock as clocks
from .clock import Clock
from .smoothing import far_from, slow, smoothed
from .trials import Trial

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_AGREES = 0.5  # of f_z's variance, that the taxels' sum must explain with its right sign


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """The rows of one trial that are fitted; block: a number that grows along the trial, for cross-validation."""

    trial: Trial
    clock: Clock
    activation: Array  # (n, slots)
    valid: Mask  # (n, slots)
    reference: Array  # (n, c)
    t_s: Array  # (n,)
    covered: float  # share of the cycles beside which the reference said something


def usable(trial: Trial) -> Mask:
    """(slots,) that are valid most of the time."""
    often: Mask = trial.valid.mean(axis=0) > 0.5
    return often


def aligned(trial: Trial) -> Clock:
    """The reference's clock against the taxels', from how both move: before there is any calibration."""
    slots = usable(trial)
    a = np.where(trial.valid[:, slots], trial.activation[:, slots], 0.0)
    if trial.kind == "chamber":
        mean = a.mean(axis=1)
        features = np.stack([mean, mean**2, mean**3], axis=1)
    else:
        x, y = trial.layout.xy_m.reshape(-1, 2)[slots].T
        arms = np.stack([np.ones_like(x), y, x], axis=1)
        features = np.concatenate([a @ arms, a**2 @ arms], axis=1)
    return _fitted(trial, features)


def realigned(trial: Trial, predicted: Array) -> Clock:
    """The clock under which the reference follows what a calibration makes of the counts, (n, c)."""
    return _fitted(trial, predicted)


def _fitted(trial: Trial, features: Array) -> Clock:
    read = trial.readings
    try:
        return clocks.fit(trial.t_s, features, read.t_s, read.values)
    except CalibrationError as error:
        raise CalibrationError(f"{trial.name}: {error}") from error


def at_cycles(trial: Trial, clock: Clock) -> Array:
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


def samples(trial: Trial, clock: Clock) -> Samples:
    """Smoothed and slow ones; CalibrationError where the reference follows the taxels with the wrong sign."""
    reference = at_cycles(trial, clock)
    said: Mask = np.asarray(np.isfinite(reference).all(axis=1))
    if trial.kind == "shoe":
        _check_foot(trial, reference, said)
    smooth = smoothed(np.where(said[:, None], reference, 0.0), trial.t_s)
    smooth[~far_from(~said)] = np.nan
    kept = slow(smooth, trial.t_s)
    activation = smoothed(trial.activation, trial.t_s)[kept]
    valid = far_from(~trial.valid)[kept]
    return Samples(trial, clock, activation, valid, smooth[kept], trial.t_s[kept], float(said.mean()))


def _check_foot(trial: Trial, reference: Array, said: Mask) -> None:
    """Raise where the reference's force or its place contradict where the insole is pressed."""
    slots = usable(trial)
    a = np.where(trial.valid[:, slots], trial.activation[:, slots], 0.0)[said]
    x, y = trial.layout.xy_m.reshape(-1, 2)[slots].T
    own = np.stack([a.sum(axis=1), a @ y, -(a @ x)], axis=1)
    wrench = reference[said]
    agrees = [float(np.corrcoef(own[:, i], wrench[:, i])[0, 1]) for i in range(3)]
    if agrees[0] < _AGREES**0.5:
        raise CalibrationError(
            f"{trial.name}: the force of the reference does not grow with what the {trial.foot.foot} insole reads "
            f"(correlation {agrees[0]:.2f}): is it that of the other foot?"
        )
    sides = {"m_x": agrees[1], "m_y": agrees[2]}
    contrary = [name for name, value in sides.items() if value < -(_AGREES**0.5)]
    if contrary:
        raise CalibrationError(
            f"{trial.name}: {' and '.join(contrary)} of the reference turn against what the {trial.foot.foot} insole "
            "reads: is it the reference of the other foot, or are its moments about another origin, or axes that "
            "point elsewhere than x forward, y to the wearer's left, z up?"
        )
