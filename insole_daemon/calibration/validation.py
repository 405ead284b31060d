"""How good a calibration is on recordings with a known load: the tables of Sorrentino et al. 2020, for any tasks.

What is judged is what the daemon would publish: its curve, its wrench, what it masks, zeroed on the recording's zero,
or on its unloaded start where it has none. No cycle is selected and nothing is filtered. Errors are insole less
reference, at the clock that fits best; DEFINITIONS says every figure in words. A calibration with effects is judged
twice: by its curves alone, and with the effects undone, each at its own best clock.
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
from .samples import aligned, realigned, reference_at_cycles
from .trials import CalibrationTrial, trials

Array = NDArray[np.float64]

FORMAT = "insole-validation/2"
GOOD_PA, GOOD_SHARE = 15e3, 0.9  # 0.15 bar on 90 % of the samples: a taxel that the follow-up calls good
_STEADY_S, _STEADY = 1.0, 0.2

DEFINITIONS = {
    "rmse": "square root of the mean squared difference between insole and reference, over all cycles",
    "accuracy": "the columns in %: 100 · (1 − Σ|error| / Σ|reference|), over the same cycles",
    "steady": f"RMSE of f_z while the reference stays within {_STEADY:.0%} of its range for ±{_STEADY_S:g} s",
    "cop": "over the cycles in which both forces reach the contact force",
    "clock": "offset of the reference's clock at which the forces agree best",
    "highest_pressure": "the highest pressure of any valid taxel in any cycle",
    "taxels": "in a chamber, RMSE of each taxel over its valid cycles; good are those with at most "
    f"{GOOD_PA / 1e5:g} bar of error in at least {GOOD_SHARE:.0%} of them",
    "extrapolated": "share of the cycles in which a valid taxel reads beyond what its curve was fitted to, or by the "
    "dynamic model beyond what its effects were identified to",
    "model": "dynamic: the effects of the calibration are undone, with nothing later than a cycle; static: its curves "
    "alone. Each is judged at the clock that fits it best",
}
# Where the published figures, which these are compared with, are not plain.
_OF_THE_PAPER = {
    "accuracy": "the published accuracies of force and moments fit this formula, which the paper does not print",
    "steady": "the paper judges T1 and T2 'at steady state'",
    "cop": "the paper's accuracy of the CoP contradicts its RMSE: T3 has 28.97 mm in x beside an accuracy of 99.94 %, "
    "which would be errors below a tenth of a millimetre; here both are of the same errors, by the formulas above",
}
FULL_DEFINITIONS = {
    name: f"{text}; {_OF_THE_PAPER[name]}" if name in _OF_THE_PAPER else text for name, text in DEFINITIONS.items()
}


@dataclass(frozen=True, slots=True)
class Tracking:
    """One quantity beside its reference."""

    rmse: float
    accuracy: float  # %


@dataclass(frozen=True, slots=True)
class ShoeResult:
    """Of one trial on a force shoe: N, N·m, m and Pa."""

    f_z: Tracking
    m_x: Tracking
    m_y: Tracking
    cop_x: Tracking
    cop_y: Tracking
    steady_rmse_n: float  # NaN where nothing is steady
    steady: float  # share of the cycles
    highest_pressure_pa: float


@dataclass(frozen=True, slots=True, eq=False)
class ChamberResult:
    """Of one trial in a chamber; taxels in the calibration's order."""

    rmse_pa: Array  # (m,) NaN where a taxel was never valid
    mean_error_pa: Array  # (m,)
    good: NDArray[np.bool_]  # (m,)
    highest_pressure_pa: float


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """Of one trial."""

    trial: CalibrationTrial
    model: ModelName | None  # None: there is only one
    clock: Clock
    outcome: ShoeResult | ChamberResult
    reference: Array  # (n, c) NaN where it said nothing
    estimate: Array  # (n, c) of the wrench, or the mean pressure of the valid taxels
    extrapolated: float

    @property
    def title(self) -> str:
        """The trial's name, with the model where there are two."""
        return self.trial.name if self.model is None else f"{self.trial.name}, {self.model}"


def validate(
    recordings: Sequence[Recording], calibration: Calibration, progress: Callable[[float], None] = lambda share: None
) -> tuple[list[Result], tuple[str, ...]]:
    """Every recording judged, and a sentence for each oddity; CalibrationError where one cannot be.

    `progress` is told the share that is judged.
    """
    found, remarks = trials(list(recordings), calibration.foot)
    models: tuple[ModelName | None, ...] = ("static", "dynamic") if calibration.effects else (None,)
    judged = []
    for trial in found:
        judged += [_judged(trial, calibration, model) for model in models]
        progress(len(judged) / (len(found) * len(models)))
    return judged, remarks


def _judged(trial: CalibrationTrial, calibration: Calibration, model: ModelName | None) -> Result:
    layout, n = trial.layout, len(trial.t_s)
    zeroed = zeros.apply(calibration, trial.foot.zero or _own_zero(trial))
    read = trial.valid.reshape(n, len(layout), -1) & zeroed.usable
    if not read.any():
        raise CalibrationError(f"{trial.name}: expected valid taxels that the calibration lists, found none")
    counts, boards = trial.foot.counts, [as_configured(board) for board in trial.foot.boards]
    said = estimate(layout, zeroed, boards, trial.foot.t_ns, counts, read, zeroed=True, model=model or "static")
    pressure_pa, valid, series = said.pressure_pa.astype(np.float64), said.valid, said.wrench
    beyond = said.beyond if zeroed.lowest_count is None else said.beyond | (counts < zeroed.lowest_count) & read
    extrapolated = float(beyond.any(axis=(1, 2)).mean())
    highest_pa = float(np.where(valid, pressure_pa, -np.inf).max())
    if trial.kind == "chamber":
        clock = aligned(trial)
        reference = reference_at_cycles(trial, clock)
        there = valid & np.isfinite(reference)[:, :, None]
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.where(valid, pressure_pa, 0.0).sum(axis=(1, 2)) / valid.sum(axis=(1, 2))
        taxels = _taxels(pressure_pa, reference[:, 0], there, calibration.usable)
        return Result(trial, model, clock, ChamberResult(*taxels, highest_pa), reference, mean[:, None], extrapolated)
    own = np.stack([series.f_z_n, series.m_x_nm, series.m_y_nm], axis=1)
    clock = realigned(trial, np.nan_to_num(own))
    reference = reference_at_cycles(trial, clock)
    outcome = _shoe(trial, series, own, reference, Contact().min_force_n, highest_pa)
    return Result(trial, model, clock, outcome, reference, own, extrapolated)


def _own_zero(trial: CalibrationTrial) -> Zero:
    shape = (len(trial.layout), -1)
    return Zero(
        trial.foot.foot, int(trial.foot.t_ns[0]), trial.rest_count.reshape(shape), trial.noise_count.reshape(shape)
    )


def _shoe(
    trial: CalibrationTrial,
    series: WrenchSeries,
    estimate: Array,
    reference: Array,
    min_force_n: float,
    highest_pa: float,
) -> ShoeResult:
    said = np.isfinite(reference).all(axis=1) & np.isfinite(estimate).all(axis=1)
    f_z, m_x, m_y = (_tracking(estimate[said, i], reference[said, i]) for i in range(3))
    force = reference[:, 0]
    contact = said & (np.nan_to_num(force) >= min_force_n) & np.isfinite(series.cop_x_m)
    cop_x = _tracking(series.cop_x_m[contact], -reference[contact, 2] / force[contact])
    cop_y = _tracking(series.cop_y_m[contact], reference[contact, 1] / force[contact])
    size = 2 * max(round(_STEADY_S / float(np.median(np.diff(trial.t_s)))), 1) + 1
    known = np.interp(trial.t_s, trial.t_s[said], force[said])
    moves = maximum_filter1d(known, size, mode="nearest") - minimum_filter1d(known, size, mode="nearest")
    # Standing still, not lying beside it: only under load.
    steady = said & (moves < _STEADY * np.ptp(known)) & (known > 0.2 * known.max())
    rmse_n = float(np.sqrt(np.mean((estimate[steady, 0] - force[steady]) ** 2))) if steady.any() else float("nan")
    return ShoeResult(f_z, m_x, m_y, cop_x, cop_y, rmse_n, float(steady.mean()), highest_pa)


def _tracking(own: Array, reference: Array) -> Tracking:
    if not len(own):
        return Tracking(float("nan"), float("nan"))
    error = own - reference
    size = float(np.abs(reference).sum())
    accuracy = 100.0 * (1.0 - float(np.abs(error).sum()) / size) if size else float("nan")
    return Tracking(float(np.sqrt(np.mean(error**2))), accuracy)


def _taxels(
    pressure_pa: Array, reference_pa: Array, there: NDArray[np.bool_], usable: NDArray[np.bool_]
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """RMSE, mean error (m,) and which are good, of the taxels that the calibration lists."""
    own = there[:, usable]
    error = np.where(own, pressure_pa[:, usable] - np.nan_to_num(reference_pa)[:, None], 0.0)
    n = own.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        rmse = np.sqrt((error**2).sum(axis=0) / n)
        mean = error.sum(axis=0) / n
        good = (own & (np.abs(error) <= GOOD_PA)).sum(axis=0) / n >= GOOD_SHARE
    return rmse, mean, good


def validation_document(results: Sequence[Result], calibration: str) -> dict[str, Any]:
    """`insole-validation/2`: everything that the tables say, NaN as null."""
    return {
        "format": FORMAT,
        "calibration": calibration,
        "foot": results[0].trial.foot.foot,
        "definitions": FULL_DEFINITIONS,
        "recordings": [_entry(each) for each in results],
    }


def _entry(result: Result) -> dict[str, Any]:
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
        "highest_pressure_pa": _number(result.outcome.highest_pressure_pa),
    }
    outcome = result.outcome
    if isinstance(outcome, ShoeResult):
        for name, unit in (("f_z", "n"), ("m_x", "nm"), ("m_y", "nm"), ("cop_x", "m"), ("cop_y", "m")):
            tracking: Tracking = getattr(outcome, name)
            entry[name] = {f"rmse_{unit}": _number(tracking.rmse), "accuracy": _number(tracking.accuracy)}
        entry["steady"] = {"f_z_rmse_n": _number(outcome.steady_rmse_n), "share": round(outcome.steady, 4)}
        return entry
    known = outcome.rmse_pa[np.isfinite(outcome.rmse_pa)]
    entry["taxels"] = {
        "listed": len(outcome.rmse_pa),
        "judged": len(known),
        "good": int(np.count_nonzero(outcome.good)),
        "rmse_pa": {name: _number(float(np.percentile(known, p))) for name, p in
                    (("p5", 5), ("median", 50), ("p95", 95), ("worst", 100))},
        "mean_error_pa": {"median": _number(float(np.nanmedian(outcome.mean_error_pa)))},
    }  # fmt: skip
    return entry


def _number(value: float) -> float | None:
    return float(f"{value:.6g}") if np.isfinite(value) else None
