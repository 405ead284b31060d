"""`insole diagnose --simulate`: simulations of chamber trials by the model, with which recordings are compared."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .recordings import load_recordings

if TYPE_CHECKING:
    from ..diagnosis.result import Diagnosis
    from ..physics.calibration import Calibration
    from ..recording.loading import FootRecording, Recording
    from .progress import Work

_NAME = "simulation"


def simulation_folders(out: Path, n: int) -> list[Path]:
    """Return the folders for the simulations of `n` recordings."""
    return [out / _NAME] if n == 1 else [out / f"{_NAME}-{i + 1}" for i in range(n)]


def model_to_simulate(
    recordings: Sequence[Recording], feet: Sequence[FootRecording], calibration: Calibration | None
) -> Calibration:
    """Return the model to simulate, with its effects; SimulationError if there is none, or if a load is not known."""
    from ..errors import SimulationError
    from ..simulation.recorded_chamber import refuse_unknown_load

    for recording, foot in zip(recordings, feet, strict=True):
        refuse_unknown_load(recording, foot)
    model = calibration if calibration is not None else feet[0].calibration
    if model is None or model.builtin:
        raise SimulationError(
            f"{recordings[0].folder}: --simulate needs a calibration of this insole, found none: give one with "
            "--calibration; insole calibrate makes it"
        )
    return model


@contextlib.contextmanager
def simulated(
    recordings: Sequence[Recording], feet: Sequence[FootRecording], model: Calibration, out: Path, work: Work
) -> Iterator[list[Recording]]:
    """Write the simulation of every recording by `model` into `out`, and remove all of them if the block fails."""
    from ..simulation.recorded_chamber import simulate_recorded

    folders = simulation_folders(out, len(recordings))
    written: list[Path] = []
    try:
        for recording, foot, folder in zip(recordings, feet, folders, strict=True):
            work(f"simulating {recording.folder.name}")
            written.append(simulate_recorded(recording, foot, model, folder))
        yield load_recordings(written)
    except BaseException:
        for folder in written:
            shutil.rmtree(folder, ignore_errors=True)
        raise


def without_effects(model: Calibration) -> Calibration:
    """Return `model` without its effects."""
    return replace(model, effects=())


def beside_effects(recordings: Sequence[Recording], model: Calibration) -> list[Recording]:
    """Return the recordings for a comparison with simulations by `model`.

    Effects delay the load that a simulation reads, so the edges of the reference would give another clock than those of
    the readings. With effects, the reference therefore counts as one with a clock of its own.
    """
    if not model.effects:
        return list(recordings)
    return [replace(recording, feet=tuple(map(_with_own_clock, recording.feet))) for recording in recordings]


def _with_own_clock(foot: FootRecording) -> FootRecording:
    return foot if foot.reference is None else replace(foot, reference=replace(foot.reference, clock="own"))


def with_simulated_effects(diagnosis: Diagnosis, model: Calibration) -> Diagnosis:
    """Return the diagnosis with a model that has both the simulated effects and the reported ones."""
    from ..physics import effects_document
    from ..simulation.recorded_chamber import effects_of_the_insole

    layout = diagnosis.results[0].seen.layout
    simulated_effects: list[dict[str, Any]] = effects_document.document(effects_of_the_insole(model), layout)
    return replace(diagnosis, model={**diagnosis.model, "effects": [*simulated_effects, *diagnosis.model["effects"]]})
