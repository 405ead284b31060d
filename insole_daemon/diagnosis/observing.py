"""Turn recordings into observations of one kind and one model, or refuse them with a reason."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ..errors import DiagnosisError, UndecidableError
from ..physics.calibration import Calibration
from ..recording.loading import FootRecording, Recording
from .excitation import require_cycles
from .observations.chamber import observe_chamber
from .observations.fitted_curves import observe_uncalibrated
from .observations.paired import observe_paired
from .observations.uncalibrated import with_uncalibrated
from .observations.walk import observe_walk
from .observations.wrench import WrenchObservation

LEAST_STEPS = 3
MANY = 0.1  # of the taxels, whose curves are doubtful
MOSTLY, ABOVE_COUNT = 0.99, 2.0  # quantile of a taxel's readings, and counts by which it is beyond the curve


def observed(
    recordings: Sequence[Recording],
    feet: Sequence[FootRecording],
    calibration: Calibration | None,
    progress: Callable[[str], None],
    simulations: Sequence[Recording],
) -> list[WrenchObservation]:
    """Return an observation per recording, by the static model; in a chamber without one, by curves that fit best."""
    is_chamber = not simulations and all(recording.kind == "chamber" for recording in recordings)
    if is_chamber and not has_model(feet[0], calibration):
        return list(observe_uncalibrated(recordings, feet, progress))
    model = static_model(recordings[0], feet[0], calibration)
    observations: list[WrenchObservation] = []
    for i, (recording, foot) in enumerate(zip(recordings, feet, strict=True)):
        progress(f"reading {recording.folder.name}")
        if simulations:
            observations.append(observe_paired(recording, foot, model, simulations[i if len(simulations) > 1 else 0]))
        else:
            observations.append(_observe(recording, foot, model))
        for doubt in _doubts_about_curves(observations[-1]):
            progress(doubt)
    return observations


def _doubts_about_curves(seen: WrenchObservation) -> Iterator[str]:
    """Say what makes the static curves of many taxels doubtful under the readings of a recording."""
    n, used = int(seen.usable.sum()), seen.usable & (np.ptp(seen.activation_count, axis=0) > 0.0)
    falls = int(np.count_nonzero(used & (seen.coefficients[1] < 0.0)))
    highest = np.quantile(seen.activation_count, MOSTLY, axis=0)
    beyond = int(np.count_nonzero(used & (highest > seen.top_count + ABOVE_COUNT)))
    if falls > MANY * n:
        yield (
            f"{seen.name}: the curves of {falls} of {n} taxels fall at no load and are taken as level there: "
            "calibrate again, with readings at no load"
        )
    if beyond > MANY * n:
        yield (
            f"{seen.name}: readings of {beyond} of {n} taxels go beyond their curves, which are taken as straight "
            "there: calibrate again, up to these loads"
        )


def _observe(recording: Recording, foot: FootRecording, model: Calibration) -> WrenchObservation:
    if recording.kind == "shoe":
        return with_uncalibrated(observe_walk(recording, foot, model))
    return observe_chamber(recording, foot, model)


def has_model(foot: FootRecording, calibration: Calibration | None) -> bool:
    """Return whether there is a calibration of this insole, in contrast to the built-in default."""
    model = calibration if calibration is not None else foot.calibration
    return model is not None and not model.builtin


def static_model(recording: Recording, foot: FootRecording, calibration: Calibration | None) -> Calibration:
    """Return the model to diagnose: `calibration`, else that of `foot`; DiagnosisError if none is static."""
    model = calibration if calibration is not None else foot.calibration
    if model is None or not has_model(foot, calibration):
        raise DiagnosisError(
            f"{recording.folder}: expected a calibration, found none: a wrench is computed from pressures. "
            "Give one with --calibration; insole calibrate makes it"
        )
    if model.effects:
        words = ", ".join(effect.law.word for effect in model.effects)
        raise DiagnosisError(f"the model has effects already ({words}), expected a static one: diagnose against that")
    return model


def refuse_mixture(recordings: Sequence[Recording], simulations: Sequence[Recording]) -> None:
    """Raise DiagnosisError if the recordings are of different kinds, or the simulations do not match them."""
    if len(simulations) not in (0, 1, len(recordings)):
        raise DiagnosisError(
            f"{len(simulations)} simulations for {len(recordings)} recordings, expected one for each, in the same "
            "order, or one for all"
        )
    others = [recording for recording in recordings if recording.kind not in ("chamber", "shoe")]
    if others and not simulations and len({recording.kind for recording in recordings}) > 1:
        raise DiagnosisError(
            f"{others[0].folder}: expected a chamber or a force shoe as in the other recordings, found kind "
            f"{others[0].kind}: leave it out"
        )


def refuse_still(chambers: Sequence[WrenchObservation]) -> None:
    """Raise UndecidableError if the pressure in all chambers together changes too rarely."""
    if chambers:
        loads = [chamber.reference.at(chamber.reference_s)[:, 0] for chamber in chambers]
        span = max(float(np.ptp(load)) for load in loads)
        require_cycles(chambers[0].name, loads, [chamber.step_s for chamber in chambers], span)


def refuse_unloaded(seen: WrenchObservation) -> None:
    """Raise UndecidableError if a foot takes too few steps and does not stand either."""
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
