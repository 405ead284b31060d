"""`insole diagnose --simulate`: the model's own simulations of chamber trials, to diagnose recordings beside them."""

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
    """Where the simulations of `n` recordings are written."""
    return [out / _NAME] if n == 1 else [out / f"{_NAME}-{i + 1}" for i in range(n)]


def model_to_simulate(
    recordings: Sequence[Recording], feet: Sequence[FootRecording], calibration: Calibration | None
) -> Calibration:
    """The model asked about, with its effects; SimulationError where there is none, or a load is not known."""
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
    """Write the simulation of every recording by `model` into `out`; none of them stays where the block fails."""
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
    """`model` without its effects."""
    return replace(model, effects=())


def beside_effects(recordings: Sequence[Recording], model: Calibration) -> list[Recording]:
    """The recordings as they are diagnosed beside simulations by `model`.

    The load that a simulation with effects tells comes late with them, so the edges of a reference would tell another
    clock than those of the readings: it is not believed to be on the clock of the frames then.
    """
    if not model.effects:
        return list(recordings)
    return [replace(each, feet=tuple(map(_with_own_clock, each.feet))) for each in recordings]


def _with_own_clock(foot: FootRecording) -> FootRecording:
    return foot if foot.reference is None else replace(foot, reference=replace(foot.reference, clock="own"))


def with_simulated_effects(found: Diagnosis, model: Calibration) -> Diagnosis:
    """The diagnosis whose model has the effects that the simulated insole had, and those that were found beside it."""
    from ..physics import effects_document
    from ..simulation.recorded_chamber import effects_of_the_insole

    had: list[dict[str, Any]] = effects_document.document(effects_of_the_insole(model), found.results[0].seen.layout)
    return replace(found, model={**found.model, "effects": [*had, *found.model["effects"]]})
