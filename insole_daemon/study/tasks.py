"""Tasks of one recording, done in a worker: one file a task, named by the content it was made from.

A task that is done is never done again: its file is there. Whatever a recording, the calibrations and the code of this
package say goes into the name, so anything that changes is worked out anew. Files appear whole or not at all; two
workers that do the same task write the same bytes.
"""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InsoleError
from ..files import unfinished, write_text
from ..mechanics.gait.body_weight import scale_to_body_weight
from ..physics import calibration as calibrations
from ..recording.loading import Recording, load
from .content import content_key, program_digest
from .document import Task

SUFFIXES: Mapping[Task, str] = {"report": "html", "steps": "npz", "validation": "json", "diagnosis": "json"}
NO_REFERENCE = "no reference"  # in place of a verdict on a foot


@dataclass(frozen=True, slots=True)
class TaskResult:
    """The file that a task made, or why there is none."""

    task: Task
    file: str | None
    problem: str


@dataclass(frozen=True, slots=True)
class Given:
    """What study.yaml gives beyond a recording: paths of calibrations, and the mass of the person."""

    judged: tuple[str, ...] = ()  # by validation
    analysed_with: tuple[str, ...] = ()  # in place of the recording's own, one a foot
    mass_kg: float | None = None


def do_tasks(folder: str, results: str, tasks: Sequence[Task], given: Given, program: str) -> list[TaskResult]:
    """Do the tasks that are not done yet with the recording `folder`; return the result of each of them.

    `program` is the `program_digest` of the command, which this worker must have too. A task that fails says why, and
    the others go on.
    """
    if program != program_digest():
        problem = (
            f"a worker on {socket.gethostname()} runs other code of insole-daemon than this command: "
            "install the same there, and start its workers again"
        )
        return [TaskResult(task, None, problem) for task in tasks]
    loaded: list[Recording] = []
    outcomes = []
    for task in tasks:
        try:
            file = Path(results) / f"{task}-{_key(Path(folder), task, given)}.{SUFFIXES[task]}"
            if not file.exists():
                Path(results).mkdir(parents=True, exist_ok=True)
                if not loaded:
                    loaded.append(load(folder, calibration_files=given.analysed_with))
                _DO[task](loaded[0], file, given)
            outcomes.append(TaskResult(task, file.name, ""))
        except (InsoleError, OSError, ValueError, ArithmeticError, subprocess.SubprocessError) as error:
            outcomes.append(TaskResult(task, None, _words(error).replace("\n", " ")))
    return outcomes


def describe_problems(outcomes: Sequence[TaskResult]) -> str:
    """Return what is missing and why, once for all tasks with the same reason; an empty text where nothing is."""
    tasks_of_problem: dict[str, list[str]] = {}
    for outcome in outcomes:
        if outcome.file is None:
            tasks_of_problem.setdefault(outcome.problem, []).append(outcome.task)
    return "; ".join(f"{', '.join(tasks)}: {problem}" for problem, tasks in tasks_of_problem.items())


def _key(folder: Path, task: Task, given: Given) -> str:
    """Return a digest of everything that the result of `task` depends on."""
    scaled = given.mass_kg if task == "steps" else None
    calibration_files = given.judged if task == "validation" else given.analysed_with
    return content_key(folder, f"{task} {scaled}", [Path(file) for file in calibration_files])


def _words(error: Exception) -> str:
    if isinstance(error, InsoleError):
        return str(error)
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return f"{type(error).__name__}: {error}"


def _report(recording: Recording, file: Path, given: Given) -> None:
    from ..view.recorded import recorded_page

    write_text(file, recorded_page(recording))


def _steps(recording: Recording, file: Path, given: Given) -> None:
    steps = recording.steps
    if not len(steps):
        raise InsoleError(f"no steps: {'; '.join(steps.remarks) or 'nobody walks'}")
    if given.mass_kg is not None:
        try:
            steps = scale_to_body_weight(steps, given.mass_kg)
        except InsoleError as error:
            raise InsoleError(f"{error}; without mass_kg in study.yaml, steps keep the forces as measured") from error
    arrays = {f"column_{name}": column for name, column in steps.columns.items()}
    arrays |= {f"curve_{name}": curve for name, curve in steps.curves.items()}
    arrays |= {"start_ns": np.array(steps.start_ns), "remarks": np.array("\n".join(steps.remarks))}
    arrays["calibrations"] = np.array(json.dumps(steps.calibrations))
    with unfinished(file) as beside, open(beside, "wb") as handle:
        np.savez(handle, **arrays)  # type: ignore[arg-type]


def _validation(recording: Recording, file: Path, given: Given) -> None:
    from ..calibration.validation import validate, validation_document
    from ..documents import Reading

    _check_references(recording)
    documents: list[dict[str, Any]] = []
    for path in map(Path, given.judged):
        document = Reading(path).document
        of_foot = document.get("foot") if isinstance(document, dict) else None
        for foot in recording.feet:
            if foot.foot != of_foot:
                continue
            if foot.reference is None:
                documents.append({"foot": foot.foot, "missing": NO_REFERENCE})
                continue
            results, _ = validate([recording], calibrations.load(path, foot.layout))
            documents.append(validation_document(results, path.name))
    if not documents:
        raise InsoleError("no calibration of a recorded foot is listed under calibrations")
    write_text(file, json.dumps(documents, indent=1, ensure_ascii=False) + "\n")


def _check_references(recording: Recording) -> None:
    """Raise InsoleError where no foot has a reference, which validation and diagnosis compare with."""
    if all(foot.reference is None for foot in recording.feet):
        raise InsoleError("no foot has a reference, so the true load is not known: add one with 'insole reference'")


def _diagnosis(recording: Recording, file: Path, given: Given) -> None:
    _check_references(recording)
    documents: list[dict[str, Any]] = []
    for foot in recording.feet:
        if foot.reference is None:
            documents.append({"foot": foot.foot, "missing": NO_REFERENCE})
            continue
        if foot.calibration is None:
            raise InsoleError(f"the {foot.foot} foot has no calibration: list one under analysed_with in study.yaml")
        with tempfile.TemporaryDirectory() as made:
            out = Path(made, "diagnosis")
            command = [sys.executable, "-m", "insole_daemon", "diagnose"]
            command += [str(recording.folder), "--out", str(out)]
            command += ["--foot", foot.foot] if len(recording.feet) > 1 else []
            replacement = recording.calibration_files.get(foot.foot)
            command += [] if replacement is None else ["--calibration", str(replacement)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if not (out / "diagnosis.json").exists():  # whatever the exit status: without a verdict there is none
                raise InsoleError(f"{foot.foot} foot: {_why_no_diagnosis(done)}")
            documents.append({"foot": foot.foot, **json.loads((out / "diagnosis.json").read_text())})
    write_text(file, json.dumps(documents, indent=1, ensure_ascii=False) + "\n")


def _why_no_diagnosis(done: subprocess.CompletedProcess[str]) -> str:
    """Return the last message of `insole diagnose`, or the signal that ended it before it had one."""
    if done.returncode < 0:
        name = signal.Signals(-done.returncode).name
        return f"the diagnosis was ended by {name}: start this command again; it may need more memory than there is"
    return (done.stderr.strip().splitlines() or ["no message"])[-1].removeprefix("insole: ")


_DO: Mapping[Task, Callable[[Recording, Path, Given], None]] = {
    "report": _report,
    "steps": _steps,
    "validation": _validation,
    "diagnosis": _diagnosis,
}
