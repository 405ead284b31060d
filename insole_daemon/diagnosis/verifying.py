"""A model on a recording that had no part in making it: what the static model and the new one are off by there."""

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
    """RMS errors on a recording; of counts where the load is known on every taxel, else of f_z in N."""

    recording: str
    unit: str
    before: float  # of the static model
    after: float  # of the model with effects

    def document(self) -> dict[str, Any]:
        """As `verification.json` has it."""
        return {"format": FORMAT, **asdict(self)}


def refuse_known(new: Recording, recordings: Sequence[Recording]) -> None:
    """DiagnosisError where `new` is one of the `recordings` that a model is made of, or tells no load."""
    if new.folder.resolve() in {each.folder.resolve() for each in recordings}:
        raise DiagnosisError(f"{new.folder}: the model is made of it: verify on another recording")
    if new.kind not in ("chamber", "shoe"):
        raise DiagnosisError(f"{new.folder}: expected a chamber or a force shoe to verify on, found kind {new.kind}")


def verify(static: Mapping[str, Any], model: Path, recording: Recording, foot: Foot) -> Verified:
    """What the contents `static` of a calibration, and the file `model`, are off by in `recording`.

    DiagnosisError where the recording has no reference that tells its load.
    """
    (own,) = choose([recording], foot)
    with tempfile.TemporaryDirectory() as folder:
        before = Path(folder) / "static.json"
        write_text(before, json.dumps(dict(static)))
        off = _off_of_walk if recording.kind == "shoe" else _off_of_chamber
        unit = "N" if recording.kind == "shoe" else "count"
        errors = [off(before, each, recording, own) for each in (before, model)]
    return Verified(recording.folder.name, unit, *errors)


def _off_of_chamber(static: Path, model: Path, recording: Recording, foot: FootRecording) -> float:
    expected = counts(model, recording)[foot.foot]
    listed = calibrations.load(static, foot.layout).usable & PRESSURE_TAXELS
    asked = foot.valid & listed & calibrations.load(model, foot.layout).usable
    return float(np.sqrt(np.mean((expected - foot.counts)[asked] ** 2)))


def _off_of_walk(static: Path, model: Path, recording: Recording, foot: FootRecording) -> float:
    """By the clock on which the edges of the static model's force agree with the reference's."""
    seen = observe_walk(recording, foot, calibrations.load(static, foot.layout))
    t_s, force = of_walk(model, recording.folder)[foot.foot]
    reference_s = seen.offset_s + (1.0 + seen.rate) * (t_s - foot.t_ns[0] * 1e-9)
    known = seen.reference.is_known(reference_s) & np.isfinite(force)
    return float(np.sqrt(np.mean((force - seen.reference.at(reference_s)[:, 0])[known] ** 2)))
