"""Recordings as observations of one kind and one model, or why they cannot be told anything from."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..errors import DiagnosisError, UndecidableError
from ..physics.calibration import Calibration
from ..recording.loading import FootRecording, Recording
from .excitation import require_cycles
from .observations.chamber import observe_chamber
from .observations.own_curves import observe_uncalibrated
from .observations.paired import observe_paired
from .observations.uncalibrated import with_uncalibrated
from .observations.walk import observe_walk
from .observations.warmth import with_warmth
from .observations.wrench import WrenchObservation

LEAST_STEPS = 3


def observed(
    recordings: Sequence[Recording],
    feet: Sequence[FootRecording],
    calibration: Calibration | None,
    progress: Callable[[str], None],
    simulations: Sequence[Recording],
) -> list[WrenchObservation]:
    """Every recording by the static model; of an insole without one in a chamber, by the curves that fit it best."""
    is_chamber = not simulations and all(each.kind == "chamber" for each in recordings)
    if is_chamber and not has_model(feet[0], calibration):
        return [with_warmth(each) for each in observe_uncalibrated(recordings, feet, progress)]
    model = static_model(recordings[0], feet[0], calibration)
    every: list[WrenchObservation] = []
    for i, (recording, foot) in enumerate(zip(recordings, feet, strict=True)):
        progress(f"reading {recording.folder.name}")
        if simulations:
            every.append(observe_paired(recording, foot, model, simulations[i if len(simulations) > 1 else 0]))
        else:
            every.append(_observe(recording, foot, model))
    return [with_warmth(each) for each in every]


def _observe(recording: Recording, foot: FootRecording, model: Calibration) -> WrenchObservation:
    if recording.kind == "shoe":
        return with_uncalibrated(observe_walk(recording, foot, model))
    return observe_chamber(recording, foot, model)


def has_model(foot: FootRecording, calibration: Calibration | None) -> bool:
    """Whether there is a calibration of this very insole, by which pressures are told."""
    model = calibration if calibration is not None else foot.calibration
    return model is not None and not model.builtin


def static_model(recording: Recording, foot: FootRecording, calibration: Calibration | None) -> Calibration:
    """The model asked about: `calibration`, else that of `foot`; DiagnosisError where there is no static one."""
    model = calibration if calibration is not None else foot.calibration
    if model is None or not has_model(foot, calibration):
        raise DiagnosisError(
            f"{recording.folder}: expected a calibration, found none: a wrench is computed from pressures. "
            "Give one with --calibration; insole calibrate makes it"
        )
    if model.effects:
        words = ", ".join(each.law.word for each in model.effects)
        raise DiagnosisError(f"the model has effects already ({words}), expected a static one: diagnose against that")
    return model


def refuse_mixture(recordings: Sequence[Recording], simulations: Sequence[Recording]) -> None:
    """DiagnosisError where recordings are not of one kind, or simulations do not go with them."""
    if len(simulations) not in (0, 1, len(recordings)):
        raise DiagnosisError(
            f"{len(simulations)} simulations for {len(recordings)} recordings, expected one for each, in the same "
            "order, or one for all"
        )
    others = [each for each in recordings if each.kind not in ("chamber", "shoe")]
    if others and not simulations and len({each.kind for each in recordings}) > 1:
        raise DiagnosisError(
            f"{others[0].folder}: expected a chamber or a force shoe as in the other recordings, found kind "
            f"{others[0].kind}: leave it out"
        )


def refuse_still(chambers: Sequence[WrenchObservation]) -> None:
    """UndecidableError where the pressure of all chambers together is hardly ever changed."""
    if chambers:
        loads = [each.reference.at(each.reference_s)[:, 0] for each in chambers]
        span = max(float(np.ptp(load)) for load in loads)
        require_cycles(chambers[0].name, loads, [each.step_s for each in chambers], span)


def refuse_unloaded(seen: WrenchObservation) -> None:
    """UndecidableError where a foot takes too few steps and does not stand, either."""
    force = seen.reference.at(seen.reference_s)[:, 0]
    if seen.load_is_known:
        return
    low, high = 0.1 * float(force.max()), 0.3 * float(force.max())
    state = np.where(force > high, 1, np.where(force < low, 0, -1))
    row = np.maximum.accumulate(np.where(state >= 0, np.arange(len(state)), 0))
    steps = int((np.diff(state[row]) == 1).sum())
    stands = float(np.mean(force > low)) > 0.9
    if steps < LEAST_STEPS and not stands:
        raise UndecidableError(
            f"{seen.name}: the foot is loaded {steps} times, expected at least {LEAST_STEPS} steps: one rise and fall "
            "fits any physics. Record a walk of a minute"
        )
