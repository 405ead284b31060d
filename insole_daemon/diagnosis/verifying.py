"""Verify a model on a recording that was not used to make it: errors of the static model and of the new one."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..config import Foot
from ..errors import DiagnosisError
from ..files import write_text
from ..physics import calibration as calibrations
from ..recording.loading import FootRecording, Recording
from ..skin.geometry import PRESSURE_TAXELS
from .compensation import of_walk
from .feet import choose
from .observations.walk import observe_walk
from .prediction import counts

FORMAT = "insole-verification/1"
FILE = "verification.json"


@dataclass(frozen=True, slots=True)
class Verified:
    """RMS errors on a recording: of counts if the load of every taxel is known, else of f_z in N."""

    recording: str
    unit: str
    before: float  # of the static model
    after: float  # of the model with effects

    def document(self) -> dict[str, Any]:
        """Return the content of `verification.json`."""
        return {"format": FORMAT, **asdict(self)}


def refuse_known(new: Recording, recordings: Sequence[Recording]) -> None:
    """Raise DiagnosisError if `new` is one of the `recordings` that the model is made of, or has no known load."""
    if new.folder.resolve() in {recording.folder.resolve() for recording in recordings}:
        raise DiagnosisError(f"{new.folder}: the model is made of it: verify on another recording")
    if new.kind not in ("chamber", "shoe"):
        raise DiagnosisError(f"{new.folder}: expected a chamber or a force shoe to verify on, found kind {new.kind}")


def verify(static: Mapping[str, Any], model: Path, recording: Recording, foot: Foot) -> Verified:
    """Return the errors of the calibration `static` and of the file `model` on `recording`.

    Raises DiagnosisError if the recording has no reference of its load.
    """
    (foot_recording,) = choose([recording], foot)
    with tempfile.TemporaryDirectory() as folder:
        before = Path(folder) / "static.json"
        write_text(before, json.dumps(dict(static)))
        rms_error = _error_of_walk if recording.kind == "shoe" else _error_of_chamber
        unit = "N" if recording.kind == "shoe" else "count"
        errors = [rms_error(before, calibration, recording, foot_recording) for calibration in (before, model)]
    return Verified(recording.folder.name, unit, *errors)


def _error_of_chamber(static: Path, model: Path, recording: Recording, foot: FootRecording) -> float:
    expected = counts(model, recording)[foot.foot]
    listed = calibrations.load(static, foot.layout).usable & PRESSURE_TAXELS
    asked = foot.valid & listed & calibrations.load(model, foot.layout).usable
    return float(np.sqrt(np.mean((expected - foot.counts)[asked] ** 2)))


def _error_of_walk(static: Path, model: Path, recording: Recording, foot: FootRecording) -> float:
    """Return the RMS error of f_z, on the clock on which the edges of the static model's force match the reference."""
    seen = observe_walk(recording, foot, calibrations.load(static, foot.layout))
    t_s, force = of_walk(model, recording.folder)[foot.foot]
    reference_s = seen.offset_s + (1.0 + seen.rate) * (t_s - foot.t_ns[0] * 1e-9)
    known = seen.reference.is_known(reference_s) & np.isfinite(force)
    return float(np.sqrt(np.mean((force - seen.reference.at(reference_s)[:, 0])[known] ** 2)))
