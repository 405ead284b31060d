"""`insole calibrate`: recordings with a known load into the curves of one foot, and all that is to be said of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..config import Foot
from ..errors import CalibrationError
from ..recording.loading import Recording
from ..skin.layout import Layout
from . import fused
from .coverage_warnings import coverage_warnings
from .fused import DEGREES, PUBLISHED_EXPONENTS, Fit, Progress
from .problem import Weights, fused_problem
from .samples import Samples, aligned, realigned, samples
from .trials import CalibrationTrial, trials
from .verdict import Verdict, verdicts

Array = NDArray[np.float64]
Method = Literal["default", "paper"]

_LEAST_SAMPLES = 20  # of a taxel in the chamber, for every unknown of its curve
_LEAST_SPAN = 0.5  # of the chamber's range, that a taxel must have been valid in
_LOADED_COUNT = 3.0  # that a shoe alone must have pressed a taxel by
_LEAST_WHOLE = 0.5  # of the shoe's samples, in which all taxels that are fitted are valid
_BEYOND = 1.2  # of the highest activation seen: so far curves are kept from falling
_MOST_ALIKE = 0.25  # of the samples


@dataclass(frozen=True, slots=True, eq=False)
class Calibrated:
    """The curves of the taxels `slots` (m,), what they come from, and what is wrong with the others."""

    foot: Foot
    layout: Layout
    method: Method
    samples: tuple[Samples, ...]
    slots: NDArray[np.intp]  # (m,)
    rest_count: Array  # (slots of the layout,) the mean of all trials
    fit: Fit
    highest_count: Array  # (m,) activation up to which a curve was seen
    verdicts: dict[int, Verdict]  # of all pressure taxels, by slot
    left_out: dict[int, str]  # why a pressure taxel has no curve, by slot
    remarks: tuple[str, ...]

    def pressure_pa(self, trial: CalibrationTrial) -> Array:
        """(n, m) of a trial, zeroed on its own start."""
        rest = self.rest_count if self.method == "paper" else trial.rest_count
        return curve_pa(self.fit.coefficients_pa, rest[self.slots] - trial.counts[:, self.slots])


def curve_pa(coefficients_pa: Array, activation: Array) -> Array:
    """(…, m) of coefficients (m, k) at activations (…, m)."""
    value = np.zeros_like(activation)
    for k in reversed(range(coefficients_pa.shape[1])):
        value = value * activation + coefficients_pa[:, k]
    return value


def calibrate(
    recordings: Sequence[Recording], foot: Foot, method: Method = "default", progress: Progress = lambda text: None
) -> Calibrated:
    """The calibration of `foot`; CalibrationError says what the recordings lack, or contradict each other in."""
    progress("cycles and references")
    found, remarks = trials(list(recordings), foot)
    progress("clocks of the references")
    ready = [samples(trial, aligned(trial)) for trial in found]
    _check_enough(ready)
    judged = verdicts(ready)
    slots, left_out = _fitted(ready, judged)
    remarks += _uncovered(ready)
    rest_count = np.mean([trial.rest_count for trial in found], axis=0)
    highest = _highest(ready, slots)
    scale_count = max(float(np.median(highest)), 1.0)
    exponents = tuple(range(1, max(DEGREES) + 1))
    first = fused_problem(ready, slots, exponents, scale_count)
    progress("first fit")
    start = fused.first_fit(first)
    ready = [_realigned(each, slots, start) for each in ready]
    alike = _alike(ready, slots, start)
    if method == "paper":
        raw = fused_problem(ready, slots, PUBLISHED_EXPONENTS, scale_count, rest_count)
        progress("the published fit")
        fit = fused.fit_as_published(raw, rest_count[slots])
    else:
        fit = fused.fit_fused(
            fused_problem(ready, slots, exponents, scale_count), alike, _BEYOND * float(highest.max()), progress
        )
    zero_std = np.sqrt(np.mean([trial.noise_count**2 / trial.rest_cycles for trial in found], axis=0))[slots]
    fit = replace(fit, covariance_pa2=fit.covariance_pa2 + zero_covariance(fit.coefficients_pa, zero_std))
    remarks += coverage_warnings(ready, curve_pa(fit.coefficients_pa, highest), len(left_out))
    return Calibrated(
        foot, found[0].layout, method, tuple(ready), slots, rest_count, fit, highest, judged, left_out, remarks
    )


def zero_covariance(coefficients_pa: Array, zero_std_count: Array) -> Array:
    """(m, k, k) covariance of coefficients (m, k) that comes of not knowing rest better than zero_std_count (m,).

    A shift of δ turns c_j into c_j + δ·(j + 1)·c_(j+1).
    """
    turn = np.zeros_like(coefficients_pa)
    turn[:, :-1] = coefficients_pa[:, 1:] * np.arange(1, coefficients_pa.shape[1])
    turn *= zero_std_count[:, None]
    covariance: Array = turn[:, :, None] * turn[:, None]
    return covariance


def _check_enough(ready: Sequence[Samples]) -> None:
    """Raise where a trial cannot determine what it is for."""
    wrong = []
    for each in ready:
        name = each.trial.name
        if len(each.t_s) < 200:
            wrong.append(
                f"{name}: expected at least 4 s in which the load changes slowly beside its reference, found "
                f"{len(each.t_s)} cycles of {len(each.trial.t_s)}: move slower, or record a longer trial"
            )
        elif each.trial.kind == "chamber":
            turns = _turns(each.reference[:, 0])
            if turns < 2:
                wrong.append(
                    f"{name}: expected the pressure to go up and down at least once, found one ramp: a delay of the "
                    "reference cannot be told from the curve then; record cycles, best at two speeds with a hold"
                )
    if wrong:
        raise CalibrationError("\n".join(wrong))


def _turns(pressure_pa: Array) -> int:
    """How many ramps of at least half the range there are."""
    low, span = float(pressure_pa.min()), float(np.ptp(pressure_pa))
    level = np.digitize((pressure_pa - low) / max(span, 1e-9), (0.25, 0.75))
    ends = level[level != 1]  # at the bottom or at the top
    return int(np.count_nonzero(np.diff(ends)))


def _fitted(ready: Sequence[Samples], judged: dict[int, Verdict]) -> tuple[NDArray[np.intp], dict[int, str]]:
    """The slots that get a curve, and why the others do not."""
    chamber = [each for each in ready if each.trial.kind == "chamber"]
    shoe = [each for each in ready if each.trial.kind == "shoe"]
    left_out: dict[int, str] = {}
    for slot, verdict in judged.items():
        why = _why_not_in_chamber(chamber, slot) if chamber else _why_not_in_shoe(shoe, slot)
        if why:
            left_out[slot] = f"{verdict.word}: {why}" if verdict.word != "healthy" else why
    slots = [slot for slot in judged if slot not in left_out]
    while shoe and slots:  # one that is seldom valid would take the samples of all others
        valid = np.concatenate([each.valid[:, slots] for each in shoe])
        if valid.all(axis=1).mean() >= _LEAST_WHOLE:
            break
        worst = slots[int(valid.mean(axis=0).argmin())]
        left_out[worst] = f"{judged[worst].word}: valid in {valid.mean(axis=0).min():.0%} of the shoe's samples"
        slots.remove(worst)
    if not slots:
        reasons = "; ".join(sorted(set(left_out.values()))[:3])
        raise CalibrationError(f"expected taxels that answer to the load, found none: {reasons}")
    unknowns = len(slots) * 3
    if not chamber and sum(3 * len(each.t_s) for each in shoe) < 5 * unknowns:
        raise CalibrationError(
            f"expected at least {5 * unknowns} numbers of the shoe for {unknowns} unknowns, found "
            f"{sum(3 * len(each.t_s) for each in shoe)}: add a chamber trial, or longer slow movements"
        )
    return np.array(slots), left_out


def _why_not_in_chamber(chamber: Sequence[Samples], slot: int) -> str:
    pressure = np.concatenate([each.reference[:, 0] for each in chamber])
    valid = np.concatenate([each.valid[:, slot] for each in chamber])
    if np.count_nonzero(valid) < _LEAST_SAMPLES * max(DEGREES):
        return f"{np.count_nonzero(valid)} valid samples in the chamber"
    activation = np.concatenate([each.activation[:, slot] for each in chamber])
    if np.ptp(pressure[valid]) < _LEAST_SPAN * np.ptp(pressure):
        return f"valid up to {pressure[valid].max() / 1e3:.0f} kPa of {pressure.max() / 1e3:.0f} only"
    high, low = np.percentile(activation[valid], (99, 1))
    return "does not answer to the chamber's pressure" if high - low < 1.0 else ""


def _why_not_in_shoe(shoe: Sequence[Samples], slot: int) -> str:
    activation = np.concatenate([each.activation[each.valid[:, slot], slot] for each in shoe])
    if not len(activation):
        return "never valid in the shoe"
    high = float(np.percentile(activation, 99.5))
    return f"never pressed by more than {high:.1f} counts in the shoe" if high < _LOADED_COUNT else ""


def _highest(ready: Sequence[Samples], slots: NDArray[np.intp]) -> Array:
    """(m,) of the smoothed activations that were fitted: where a curve was seen."""
    highest = np.zeros(len(slots))
    for each in ready:
        highest = np.maximum(highest, np.where(each.valid[:, slots], each.activation[:, slots], 0.0).max(axis=0))
    return highest


def _predicted(each: Samples, slots: NDArray[np.intp], coefficients_pa: Array, arms: Array) -> Array:
    """(n, 3) wrench of all cycles of a trial."""
    valid = each.trial.valid[:, slots]
    pressure = np.where(valid, curve_pa(coefficients_pa, each.trial.activation[:, slots]), 0.0)
    return pressure @ arms.T


def _realigned(each: Samples, slots: NDArray[np.intp], start: fused.Start) -> Samples:
    """With the clock that fits what a first calibration makes of the counts."""
    if each.trial.kind == "chamber":  # its mean is what the clock was found by
        return each
    predicted = _predicted(each, slots, start.coefficients_pa, start.arms)
    return samples(each.trial, realigned(each.trial, predicted))


def _alike(ready: Sequence[Samples], slots: NDArray[np.intp], start: fused.Start) -> Weights:
    """How many samples say the same: the correlation time of what a first fit leaves."""
    shoe, chamber = [np.ones(3)], [1.0]
    for each in ready:
        pressure = curve_pa(start.coefficients_pa, each.activation[:, slots])
        if each.trial.kind == "shoe":
            left = pressure @ start.arms.T - each.reference
            line = np.stack([np.ones_like(each.t_s), each.t_s], axis=1)
            shoe.append(correlation_samples(left - line @ np.linalg.lstsq(line, left, rcond=None)[0]))
        else:
            chamber.append(float(np.median(correlation_samples(pressure - each.reference))))
    return Weights(np.max(shoe, axis=0), np.full(len(slots), max(chamber)))


def correlation_samples(residual: Array) -> Array:
    """(c,) integrated autocorrelation time in samples of residuals (n, c), at least 1."""
    n = len(residual)
    spectrum = np.fft.rfft(residual - residual.mean(axis=0), 2 * n, axis=0)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2, axis=0)[: max(int(n * _MOST_ALIKE), 1)]
    correlation = correlation / np.maximum(correlation[0], 1e-30)
    ended = np.cumsum(correlation < 0.05, axis=0) > 0
    time: Array = 2 * np.where(ended, 0.0, correlation).sum(axis=0) - 1
    return np.clip(time, 1.0, None)


def _uncovered(ready: Sequence[Samples]) -> tuple[str, ...]:
    return tuple(
        f"{each.trial.name}: the reference covers {each.covered:.0%} of the cycles; the others are left out"
        for each in ready
        if each.covered < 0.98
    )
