"""Fit the curves of one foot to recordings with a known load, for `insole calibrate`."""

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
from .problem import Weights, build_fused_problem
from .samples import Samples, align_by_activation, align_by_prediction, select_samples
from .trials import CalibrationTrial, prepare_trials
from .verdict import Verdict, judge_taxels

Array = NDArray[np.float64]
Method = Literal["default", "paper"]

_MIN_SAMPLES_PER_UNKNOWN = 20  # valid chamber samples per unknown of a taxel's curve
_MIN_RANGE = 0.5  # fraction of the chamber's pressure range in which a taxel must have been valid
_MIN_SHOE_COUNT = 3.0  # activation that a taxel must reach in a shoe if there is no chamber trial
_MIN_COMPLETE = 0.5  # fraction of the shoe's samples in which all fitted taxels are valid
_LIMIT_FACTOR = 1.2  # times the highest activation seen, up to which curves may not fall
_MAX_CORRELATION = 0.25  # longest correlation time, as a fraction of the samples


@dataclass(frozen=True, slots=True, eq=False)
class Calibrated:
    """Result of a calibration: the curves of the taxels `slots` (m,), their data, and the taxels without a curve."""

    foot: Foot
    layout: Layout
    method: Method
    samples: tuple[Samples, ...]
    slots: NDArray[np.intp]  # (m,)
    rest_count: Array  # (slots of the layout,) mean of all trials
    fit: Fit
    highest_count: Array  # (m,) activation up to which a curve was fitted
    verdicts: dict[int, Verdict]  # of all pressure taxels, by slot
    left_out: dict[int, str]  # the reason why a pressure taxel has no curve, by slot
    remarks: tuple[str, ...]

    def pressure_pa(self, trial: CalibrationTrial) -> Array:
        """Return (n, m) the pressures of a trial, relative to its own unloaded start."""
        rest = self.rest_count if self.method == "paper" else trial.rest_count
        return curve_pa(self.fit.coefficients_pa, rest[self.slots] - trial.counts[:, self.slots])


def curve_pa(coefficients_pa: Array, activation: Array) -> Array:
    """Return (…, m) the pressures of the curves with coefficients (m, k) at activations (…, m) in counts."""
    value = np.zeros_like(activation)
    for k in reversed(range(coefficients_pa.shape[1])):
        value = value * activation + coefficients_pa[:, k]
    return value


def calibrate(
    recordings: Sequence[Recording], foot: Foot, method: Method = "default", progress: Progress = lambda text: None
) -> Calibrated:
    """Calibrate `foot`; CalibrationError states what the recordings lack or where they contradict each other."""
    progress("cycles and references")
    foot_trials, remarks = prepare_trials(list(recordings), foot)
    progress("clocks of the references")
    fit_samples = [select_samples(trial, align_by_activation(trial)) for trial in foot_trials]
    _check_enough(fit_samples)
    taxel_verdicts = judge_taxels(fit_samples)
    slots, left_out = _select_slots(fit_samples, taxel_verdicts)
    remarks += _coverage_remarks(fit_samples)
    rest_count = np.mean([trial.rest_count for trial in foot_trials], axis=0)
    highest = _highest_activation(fit_samples, slots)
    scale_count = max(float(np.median(highest)), 1.0)
    exponents = tuple(range(1, max(DEGREES) + 1))
    first_problem = build_fused_problem(fit_samples, slots, exponents, scale_count)
    progress("first fit")
    first_fit = fused.first_fit(first_problem)
    fit_samples = [_align_again(trial_samples, slots, first_fit) for trial_samples in fit_samples]
    n_correlated = _count_correlated(fit_samples, slots, first_fit)
    if method == "paper":
        raw_problem = build_fused_problem(fit_samples, slots, PUBLISHED_EXPONENTS, scale_count, rest_count)
        progress("the published fit")
        fit = fused.fit_as_published(raw_problem, rest_count[slots])
    else:
        fit = fused.fit_fused(
            build_fused_problem(fit_samples, slots, exponents, scale_count),
            n_correlated,
            _LIMIT_FACTOR * float(highest.max()),
            progress,
        )
    zero_std = np.sqrt(np.mean([trial.noise_count**2 / trial.rest_cycles for trial in foot_trials], axis=0))[slots]
    fit = replace(fit, covariance_pa2=fit.covariance_pa2 + zero_covariance(fit.coefficients_pa, zero_std))
    remarks += coverage_warnings(fit_samples, curve_pa(fit.coefficients_pa, highest), len(left_out))
    return Calibrated(
        foot,
        foot_trials[0].layout,
        method,
        tuple(fit_samples),
        slots,
        rest_count,
        fit,
        highest,
        taxel_verdicts,
        left_out,
        remarks,
    )


def zero_covariance(coefficients_pa: Array, zero_std_count: Array) -> Array:
    """Return (m, k, k) the covariance of coefficients (m, k) from the uncertainty `zero_std_count` (m,) of the
    baseline.

    A shift of the baseline by δ changes c_j to c_j + δ·(j + 1)·c_(j+1).
    """
    shift_derivative = np.zeros_like(coefficients_pa)
    shift_derivative[:, :-1] = coefficients_pa[:, 1:] * np.arange(1, coefficients_pa.shape[1])
    shift_derivative *= zero_std_count[:, None]
    covariance: Array = shift_derivative[:, :, None] * shift_derivative[:, None]
    return covariance


def _check_enough(fit_samples: Sequence[Samples]) -> None:
    """Raise CalibrationError if a trial cannot determine the curves."""
    errors = []
    for trial_samples in fit_samples:
        name = trial_samples.trial.name
        if len(trial_samples.t_s) < 200:
            errors.append(
                f"{name}: expected at least 4 s in which the load changes slowly beside its reference, found "
                f"{len(trial_samples.t_s)} cycles of {len(trial_samples.trial.t_s)}: move slower, "
                "or record a longer trial"
            )
        elif trial_samples.trial.kind == "chamber":
            n_ramps = _count_ramps(trial_samples.reference[:, 0])
            if n_ramps < 2:
                errors.append(
                    f"{name}: expected the pressure to go up and down at least once, found one ramp: a delay of the "
                    "reference cannot be separated from the curve then; record cycles, best at two speeds with a hold"
                )
    if errors:
        raise CalibrationError("\n".join(errors))


def _count_ramps(pressure_pa: Array) -> int:
    """Return the number of ramps that span at least half of the range."""
    low, span = float(pressure_pa.min()), float(np.ptp(pressure_pa))
    level = np.digitize((pressure_pa - low) / max(span, 1e-9), (0.25, 0.75))
    ends = level[level != 1]  # at the bottom or at the top
    return int(np.count_nonzero(np.diff(ends)))


def _select_slots(
    fit_samples: Sequence[Samples], taxel_verdicts: dict[int, Verdict]
) -> tuple[NDArray[np.intp], dict[int, str]]:
    """Return the slots that get a curve, and the reason for every other slot."""
    chamber = [trial_samples for trial_samples in fit_samples if trial_samples.trial.kind == "chamber"]
    shoe = [trial_samples for trial_samples in fit_samples if trial_samples.trial.kind == "shoe"]
    left_out: dict[int, str] = {}
    for slot, verdict in taxel_verdicts.items():
        why = _why_not_in_chamber(chamber, slot) if chamber else _why_not_in_shoe(shoe, slot)
        if why:
            left_out[slot] = f"{verdict.word}: {why}" if verdict.word != "healthy" else why
    slots = [slot for slot in taxel_verdicts if slot not in left_out]
    while shoe and slots:  # a taxel that is seldom valid would remove samples of all others
        valid = np.concatenate([trial_samples.valid[:, slots] for trial_samples in shoe])
        if valid.all(axis=1).mean() >= _MIN_COMPLETE:
            break
        worst = slots[int(valid.mean(axis=0).argmin())]
        left_out[worst] = f"{taxel_verdicts[worst].word}: valid in {valid.mean(axis=0).min():.0%} of the shoe's samples"
        slots.remove(worst)
    if not slots:
        reasons = "; ".join(sorted(set(left_out.values()))[:3])
        raise CalibrationError(f"expected taxels that answer to the load, found none: {reasons}")
    unknowns = len(slots) * 3
    if not chamber and sum(3 * len(trial_samples.t_s) for trial_samples in shoe) < 5 * unknowns:
        raise CalibrationError(
            f"expected at least {5 * unknowns} numbers of the shoe for {unknowns} unknowns, found "
            f"{sum(3 * len(trial_samples.t_s) for trial_samples in shoe)}: add a chamber trial, "
            "or longer slow movements"
        )
    return np.array(slots), left_out


def _why_not_in_chamber(chamber: Sequence[Samples], slot: int) -> str:
    """Return why the chamber samples cannot determine the taxel's curve; empty if they can."""
    pressure = np.concatenate([trial_samples.reference[:, 0] for trial_samples in chamber])
    valid = np.concatenate([trial_samples.valid[:, slot] for trial_samples in chamber])
    if np.count_nonzero(valid) < _MIN_SAMPLES_PER_UNKNOWN * max(DEGREES):
        return f"{np.count_nonzero(valid)} valid samples in the chamber"
    activation = np.concatenate([trial_samples.activation[:, slot] for trial_samples in chamber])
    if np.ptp(pressure[valid]) < _MIN_RANGE * np.ptp(pressure):
        return f"valid up to {pressure[valid].max() / 1e3:.0f} kPa of {pressure.max() / 1e3:.0f} only"
    high, low = np.percentile(activation[valid], (99, 1))
    return "does not answer to the chamber's pressure" if high - low < 1.0 else ""


def _why_not_in_shoe(shoe: Sequence[Samples], slot: int) -> str:
    """Return why the shoe samples cannot determine the taxel's curve; empty if they can."""
    activation = np.concatenate(
        [trial_samples.activation[trial_samples.valid[:, slot], slot] for trial_samples in shoe]
    )
    if not len(activation):
        return "never valid in the shoe"
    high = float(np.percentile(activation, 99.5))
    return f"never pressed by more than {high:.1f} counts in the shoe" if high < _MIN_SHOE_COUNT else ""


def _highest_activation(fit_samples: Sequence[Samples], slots: NDArray[np.intp]) -> Array:
    """Return (m,) the highest smoothed activations that are fitted."""
    highest = np.zeros(len(slots))
    for trial_samples in fit_samples:
        highest = np.maximum(
            highest, np.where(trial_samples.valid[:, slots], trial_samples.activation[:, slots], 0.0).max(axis=0)
        )
    return highest


def _predict_wrench(trial_samples: Samples, slots: NDArray[np.intp], coefficients_pa: Array, arms: Array) -> Array:
    """Return (n, 3) the wrench in all cycles of a trial."""
    valid = trial_samples.trial.valid[:, slots]
    pressure = np.where(valid, curve_pa(coefficients_pa, trial_samples.trial.activation[:, slots]), 0.0)
    return pressure @ arms.T


def _align_again(trial_samples: Samples, slots: NDArray[np.intp], first_fit: fused.InitialFit) -> Samples:
    """Select the samples again, with the clock that fits the wrench of a first calibration."""
    if trial_samples.trial.kind == "chamber":  # its clock was already fitted to the mean activation
        return trial_samples
    predicted = _predict_wrench(trial_samples, slots, first_fit.coefficients_pa, first_fit.arms)
    return select_samples(trial_samples.trial, align_by_prediction(trial_samples.trial, predicted))


def _count_correlated(fit_samples: Sequence[Samples], slots: NDArray[np.intp], first_fit: fused.InitialFit) -> Weights:
    """Return how many samples count as one, by the correlation time of the residuals of a first fit."""
    shoe, chamber = [np.ones(3)], [1.0]
    for trial_samples in fit_samples:
        pressure = curve_pa(first_fit.coefficients_pa, trial_samples.activation[:, slots])
        if trial_samples.trial.kind == "shoe":
            residual = pressure @ first_fit.arms.T - trial_samples.reference
            line = np.stack([np.ones_like(trial_samples.t_s), trial_samples.t_s], axis=1)
            shoe.append(correlation_samples(residual - line @ np.linalg.lstsq(line, residual, rcond=None)[0]))
        else:
            chamber.append(float(np.median(correlation_samples(pressure - trial_samples.reference))))
    return Weights(np.max(shoe, axis=0), np.full(len(slots), max(chamber)))


def correlation_samples(residual: Array) -> Array:
    """Return (c,) the integrated autocorrelation time, in samples, of residuals (n, c); at least 1."""
    n = len(residual)
    spectrum = np.fft.rfft(residual - residual.mean(axis=0), 2 * n, axis=0)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2, axis=0)[: max(int(n * _MAX_CORRELATION), 1)]
    correlation = correlation / np.maximum(correlation[0], 1e-30)
    has_decayed = np.cumsum(correlation < 0.05, axis=0) > 0
    correlation_time: Array = 2 * np.where(has_decayed, 0.0, correlation).sum(axis=0) - 1
    return np.clip(correlation_time, 1.0, None)


def _coverage_remarks(fit_samples: Sequence[Samples]) -> tuple[str, ...]:
    return tuple(
        f"{trial_samples.trial.name}: the reference covers {trial_samples.covered:.0%} of the cycles; "
        "the others are left out"
        for trial_samples in fit_samples
        if trial_samples.covered < 0.98
    )
