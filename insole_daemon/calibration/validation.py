"""Evaluate a calibration on recordings with a known load, with the tables of Sorrentino et al. 2020.

Evaluates what the daemon would publish: its curves, wrench and masks, zeroed on the recording's zero or, without one,
on its unloaded start. No cycle is selected and nothing is filtered. Errors are insole minus reference, at the best
clock; DEFINITIONS explains every figure. A calibration with effects is evaluated twice, by its curves alone and with
the effects inverted, each at its own best clock.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from ..config import Contact
from ..errors import CalibrationError
from ..mechanics.wrench import WrenchSeries
from ..physics import zero as zeros
from ..physics.calibration import Calibration
from ..physics.zero import Zero
from ..recording.estimate import ModelName, estimate
from ..recording.loading import Recording, as_configured
from .clock import Clock
from .samples import align_by_activation, align_by_prediction, reference_at_cycles
from .trials import CalibrationTrial, prepare_trials

Array = NDArray[np.float64]

FORMAT = "insole-validation/2"
GOOD_PA, GOOD_SHARE = 15e3, 0.9  # 0.15 bar on 90 % of the samples: the follow-up's definition of a good taxel
_STEADY_S, _STEADY = 1.0, 0.2

DEFINITIONS = {
    "rmse": "square root of the mean squared difference between insole and reference, over all cycles",
    "accuracy": "the figures in %: 100 · (1 − Σ|error| / Σ|reference|), over the same cycles",
    "steady": f"RMSE of f_z while the reference stays within {_STEADY:.0%} of its range for ±{_STEADY_S:g} s",
    "cop": "over the cycles in which both forces reach the contact force",
    "clock": "offset of the reference's clock at which the forces agree best",
    "highest_pressure": "the highest pressure of any valid taxel in any cycle",
    "taxels": "in a chamber, RMSE of each taxel over its valid cycles; a good taxel has at most "
    f"{GOOD_PA / 1e5:g} bar of error in at least {GOOD_SHARE:.0%} of them",
    "extrapolated": "fraction of the cycles in which a valid taxel is outside the range of its curve or, in the "
    "dynamic model, outside the range in which the effects were identified",
    "model": "dynamic: the effects of the calibration are inverted causally; static: its curves "
    "alone. Each is evaluated at its best clock",
}
# Notes on published figures whose definition is ambiguous.
_NOTES_ON_PAPER = {
    "accuracy": "the published accuracies of force and moments fit this formula, which the paper does not print",
    "steady": "the paper judges T1 and T2 'at steady state'",
    "cop": "the paper's accuracy of the CoP contradicts its RMSE: T3 has 28.97 mm in x beside an accuracy of 99.94 %, "
    "which would be errors below a tenth of a millimetre; here both are of the same errors, by the formulas above",
}
FULL_DEFINITIONS = {
    name: f"{text}; {_NOTES_ON_PAPER[name]}" if name in _NOTES_ON_PAPER else text for name, text in DEFINITIONS.items()
}


@dataclass(frozen=True, slots=True)
class Tracking:
    """Error of one quantity relative to its reference."""

    rmse: float
    accuracy: float  # %


@dataclass(frozen=True, slots=True)
class ShoeResult:
    """Result of one trial on a force shoe, in N, N·m, m and Pa."""

    f_z: Tracking
    m_x: Tracking
    m_y: Tracking
    cop_x: Tracking
    cop_y: Tracking
    steady_rmse_n: float  # NaN without steady cycles
    steady: float  # fraction of the cycles
    highest_pressure_pa: float


@dataclass(frozen=True, slots=True, eq=False)
class ChamberResult:
    """Result of one trial in a chamber; taxels in the calibration's order."""

    rmse_pa: Array  # (m,) NaN if a taxel was never valid
    mean_error_pa: Array  # (m,)
    good: NDArray[np.bool_]  # (m,)
    highest_pressure_pa: float


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """Result of one trial with one model."""

    trial: CalibrationTrial
    model: ModelName | None  # None: the calibration has no effects
    clock: Clock
    outcome: ShoeResult | ChamberResult
    reference: Array  # (n, c) NaN without a reading
    estimate: Array  # (n, c) the wrench, or the mean pressure of the valid taxels
    extrapolated: float

    @property
    def title(self) -> str:
        """Return the trial's name, followed by the model if there are two."""
        return self.trial.name if self.model is None else f"{self.trial.name}, {self.model}"


def validate(
    recordings: Sequence[Recording], calibration: Calibration, progress: Callable[[float], None] = lambda share: None
) -> tuple[list[Result], tuple[str, ...]]:
    """Evaluate every recording; return the results and a sentence for each irregularity.

    `progress` is called with the fraction done. Raises CalibrationError if a recording cannot be evaluated.
    """
    foot_trials, remarks = prepare_trials(list(recordings), calibration.foot)
    models: tuple[ModelName | None, ...] = ("static", "dynamic") if calibration.effects else (None,)
    results = []
    for trial in foot_trials:
        results += [_evaluate(trial, calibration, model) for model in models]
        progress(len(results) / (len(foot_trials) * len(models)))
    return results, remarks


def _evaluate(trial: CalibrationTrial, calibration: Calibration, model: ModelName | None) -> Result:
    """Evaluate one trial with one model."""
    layout, n = trial.layout, len(trial.t_s)
    zeroed = zeros.apply(calibration, trial.foot.zero or _zero_of_start(trial))
    is_readable = trial.valid.reshape(n, len(layout), -1) & zeroed.usable
    if not is_readable.any():
        raise CalibrationError(f"{trial.name}: expected valid taxels that the calibration lists, found none")
    counts, boards = trial.foot.counts, [as_configured(board) for board in trial.foot.boards]
    estimated = estimate(
        layout, zeroed, boards, trial.foot.t_ns, counts, is_readable, zeroed=True, model=model or "static"
    )
    pressure_pa, valid, series = estimated.pressure_pa.astype(np.float64), estimated.valid, estimated.wrench
    beyond = (
        estimated.beyond
        if zeroed.lowest_count is None
        else estimated.beyond | (counts < zeroed.lowest_count) & is_readable
    )
    extrapolated = float(beyond.any(axis=(1, 2)).mean())
    highest_pa = float(np.where(valid, pressure_pa, -np.inf).max())
    if trial.kind == "chamber":
        clock = align_by_activation(trial)
        reference = reference_at_cycles(trial, clock)
        is_compared = valid & np.isfinite(reference)[:, :, None]
        with np.errstate(invalid="ignore", divide="ignore"):
            mean_pa = np.where(valid, pressure_pa, 0.0).sum(axis=(1, 2)) / valid.sum(axis=(1, 2))
        taxels = _evaluate_taxels(pressure_pa, reference[:, 0], is_compared, calibration.usable)
        return Result(
            trial, model, clock, ChamberResult(*taxels, highest_pa), reference, mean_pa[:, None], extrapolated
        )
    wrench = np.stack([series.f_z_n, series.m_x_nm, series.m_y_nm], axis=1)
    clock = align_by_prediction(trial, np.nan_to_num(wrench))
    reference = reference_at_cycles(trial, clock)
    outcome = _evaluate_shoe(trial, series, wrench, reference, Contact().min_force_n, highest_pa)
    return Result(trial, model, clock, outcome, reference, wrench, extrapolated)


def _zero_of_start(trial: CalibrationTrial) -> Zero:
    shape = (len(trial.layout), -1)
    return Zero(
        trial.foot.foot, int(trial.foot.t_ns[0]), trial.rest_count.reshape(shape), trial.noise_count.reshape(shape)
    )


def _evaluate_shoe(
    trial: CalibrationTrial,
    series: WrenchSeries,
    estimate: Array,
    reference: Array,
    min_force_n: float,
    highest_pa: float,
) -> ShoeResult:
    """Compare the wrench `estimate` (n, 3) with `reference` (n, 3), and the CoPs during contact."""
    is_known = np.isfinite(reference).all(axis=1) & np.isfinite(estimate).all(axis=1)
    f_z, m_x, m_y = (_compare(estimate[is_known, i], reference[is_known, i]) for i in range(3))
    force = reference[:, 0]
    contact = is_known & (np.nan_to_num(force) >= min_force_n) & np.isfinite(series.cop_x_m)
    cop_x = _compare(series.cop_x_m[contact], -reference[contact, 2] / force[contact])
    cop_y = _compare(series.cop_y_m[contact], reference[contact, 1] / force[contact])
    size = 2 * max(round(_STEADY_S / float(np.median(np.diff(trial.t_s)))), 1) + 1
    filled_force = np.interp(trial.t_s, trial.t_s[is_known], force[is_known])
    force_range = maximum_filter1d(filled_force, size, mode="nearest") - minimum_filter1d(
        filled_force, size, mode="nearest"
    )
    # Only under load: an unloaded shoe is steady too.
    steady = is_known & (force_range < _STEADY * np.ptp(filled_force)) & (filled_force > 0.2 * filled_force.max())
    rmse_n = float(np.sqrt(np.mean((estimate[steady, 0] - force[steady]) ** 2))) if steady.any() else float("nan")
    return ShoeResult(f_z, m_x, m_y, cop_x, cop_y, rmse_n, float(steady.mean()), highest_pa)


def _compare(estimated: Array, reference: Array) -> Tracking:
    if not len(estimated):
        return Tracking(float("nan"), float("nan"))
    error = estimated - reference
    size = float(np.abs(reference).sum())
    accuracy = 100.0 * (1.0 - float(np.abs(error).sum()) / size) if size else float("nan")
    return Tracking(float(np.sqrt(np.mean(error**2))), accuracy)


def _evaluate_taxels(
    pressure_pa: Array, reference_pa: Array, is_compared: NDArray[np.bool_], usable: NDArray[np.bool_]
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return RMSE and mean error (m,) and which are good, for the taxels that the calibration lists."""
    is_taxel_compared = is_compared[:, usable]
    error = np.where(is_taxel_compared, pressure_pa[:, usable] - np.nan_to_num(reference_pa)[:, None], 0.0)
    n = is_taxel_compared.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        rmse = np.sqrt((error**2).sum(axis=0) / n)
        mean = error.sum(axis=0) / n
        good = (is_taxel_compared & (np.abs(error) <= GOOD_PA)).sum(axis=0) / n >= GOOD_SHARE
    return rmse, mean, good


def validation_document(results: Sequence[Result], calibration: str) -> dict[str, Any]:
    """Return the content of an `insole-validation/2` file: all figures of the tables, NaN as null."""
    return {
        "format": FORMAT,
        "calibration": calibration,
        "foot": results[0].trial.foot.foot,
        "definitions": FULL_DEFINITIONS,
        "recordings": [_result_entry(result) for result in results],
    }


def _result_entry(result: Result) -> dict[str, Any]:
    """Return one trial's entry in an `insole-validation/2` file."""
    entry: dict[str, Any] = {
        "name": result.trial.name,
        "model": result.model,
        "kind": result.trial.kind,
        "cycles": len(result.trial.t_s),
        "clock": {
            "offset_s": round(result.clock.offset_s, 5),
            "offset_std_s": round(result.clock.offset_std_s, 5),
            "rate": float(f"{result.clock.rate:.6g}"),
            "rate_std": float(f"{result.clock.rate_std:.6g}"),
        },
        "extrapolated": round(result.extrapolated, 4),
        "highest_pressure_pa": _rounded_or_none(result.outcome.highest_pressure_pa),
    }
    outcome = result.outcome
    if isinstance(outcome, ShoeResult):
        for name, unit in (("f_z", "n"), ("m_x", "nm"), ("m_y", "nm"), ("cop_x", "m"), ("cop_y", "m")):
            tracking: Tracking = getattr(outcome, name)
            entry[name] = {
                f"rmse_{unit}": _rounded_or_none(tracking.rmse),
                "accuracy": _rounded_or_none(tracking.accuracy),
            }
        entry["steady"] = {"f_z_rmse_n": _rounded_or_none(outcome.steady_rmse_n), "share": round(outcome.steady, 4)}
        return entry
    known = outcome.rmse_pa[np.isfinite(outcome.rmse_pa)]
    entry["taxels"] = {
        "listed": len(outcome.rmse_pa),
        "judged": len(known),
        "good": int(np.count_nonzero(outcome.good)),
        "rmse_pa": {name: _rounded_or_none(float(np.percentile(known, p))) for name, p in
                    (("p5", 5), ("median", 50), ("p95", 95), ("worst", 100))},
        "mean_error_pa": {"median": _rounded_or_none(float(np.nanmedian(outcome.mean_error_pa)))},
    }  # fmt: skip
    return entry


def _rounded_or_none(value: float) -> float | None:
    return float(f"{value:.6g}") if np.isfinite(value) else None
