"""study.yaml: which recordings a study has, of whom, and what is done with each (`insole-study/1`)."""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal, get_args

from ..documents import Key, Reading, Section, at_least, read, within
from ..errors import FileError

FORMAT = "insole-study/1"
FILE = "study.yaml"

Task = Literal["report", "steps", "validation", "diagnosis"]
TASKS: tuple[Task, ...] = get_args(Task)


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyRecording(Section):
    """One line of the study."""

    folder: Path  # as in the file, from the study's folder
    person: str
    session: str
    condition: str = ""
    mass_kg: Annotated[float, within(2.0, 500.0)] | None = None  # that forces of its steps are scaled to
    analysed_with: tuple[Path, ...] = ()  # calibrations in place of the recording's own, one a foot


@dataclass(frozen=True, slots=True, kw_only=True)
class Study(Section):
    """All of study.yaml."""

    recordings: Annotated[tuple[StudyRecording, ...], at_least(1)]
    tasks: Annotated[tuple[Task, ...], at_least(1)] = ("report", "steps")
    calibrations: tuple[Path, ...] = ()  # that validation judges, one a foot


def load_study(folder: Path) -> Study:
    """Return the study in `folder`; FileError where there is none, DocumentError lists all that is wrong with it."""
    if not (folder / FILE).is_file():
        raise FileError(
            f"{folder}: expected a folder with a {FILE}, which lists recordings; docs/study.md has an example"
        )
    study = read(folder / FILE, Study, FORMAT, _check)
    relative = tuple(
        replace(recording, folder=Path(os.path.relpath(recording.folder, folder))) for recording in study.recordings
    )
    return replace(study, recordings=relative)


def _check(reading: Reading) -> None:
    named = Counter(os.path.realpath(recording.folder) for _, recording in reading.of(StudyRecording))
    for name, count in named.items():
        if count > 1:
            reading.problem(("recordings",), f"expected each recording once, found {name} {count} times")
    recordings = reading.of(StudyRecording)
    weighed, unweighed = (
        {recording.person for _, recording in recordings if (recording.mass_kg is None) is unknown}
        for unknown in (False, True)
    )
    for person in sorted(weighed & unweighed):
        message = f"expected mass_kg in every recording of {person}, or in none: scaled forces compare with scaled ones"
        reading.problem(("recordings",), message)
    files: list[tuple[Key, Path]] = [
        ((*key, "analysed_with", at), file)
        for key, recording in recordings
        for at, file in enumerate(recording.analysed_with)
    ]
    files += [
        (("calibrations", at), file) for _, study in reading.of(Study) for at, file in enumerate(study.calibrations)
    ]
    for key, file in files:
        if not file.is_file():
            reading.problem(key, f"expected a calibration, found that there is no file {file}")
    tasks = reading.document.get("tasks")
    if isinstance(tasks, list) and "validation" in tasks and not reading.document.get("calibrations"):
        reading.problem(("calibrations",), "missing key: validation judges calibrations: list them, or leave it out")
