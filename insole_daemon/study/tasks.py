"""Tasks of one recording, done in a worker: one file a task, named by the content it was made from.

A task that is done is never done again: its file is there. Whatever a recording, the calibrations and the version of
this package say goes into the name, so anything that changes is worked out anew. Files appear whole or not at all; two
workers that do the same task write the same bytes.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .. import __version__
from ..errors import InsoleError
from ..files import unfinished, write_text
from ..physics import calibration as calibrations
from ..recording.loading import Recording, load
from .document import Task

SUFFIXES: Mapping[Task, str] = {"report": "html", "steps": "npz", "validation": "json", "diagnosis": "json"}
_VERDICT_STATUSES = (0, 1, 3)  # of `insole diagnose`: it has come to a verdict
_KEY_DIGITS = 16
_OF_RECORDINGS = (".yaml", ".log", ".gz", ".zst", ".csv", ".json", ".npz")  # not a report.html that is in the folder


@dataclass(frozen=True, slots=True)
class TaskResult:
    """The file that a task made, or why there is none."""

    task: Task
    file: str | None
    problem: str


def do_tasks(folder: str, results: str, tasks: Sequence[Task], judged: Sequence[str]) -> list[TaskResult]:
    """Do the tasks that are not done yet with the recording `folder`; return the result of each of them.

    `judged` are calibrations that validation compares. A task that fails says why, and the others go on.
    """
    loaded: list[Recording] = []
    outcomes = []
    for task in tasks:
        try:
            file = Path(results) / f"{task}-{content_key(Path(folder), task, judged)}.{SUFFIXES[task]}"
            if not file.exists():
                Path(results).mkdir(parents=True, exist_ok=True)
                if not loaded:
                    loaded.append(load(folder))
                _DO[task](loaded[0], file, [Path(calibration) for calibration in judged])
            outcomes.append(TaskResult(task, file.name, ""))
        except (InsoleError, OSError, ValueError, ArithmeticError, subprocess.SubprocessError) as error:
            outcomes.append(TaskResult(task, None, _words(error).replace("\n", " ")))
    return outcomes


def content_key(folder: Path, task: Task, judged: Sequence[str]) -> str:
    """Return a digest of everything that the result of `task` depends on; InsoleError: the recording is not there."""
    if not folder.is_dir():
        raise InsoleError(f"{folder}: there is no such folder; check its line in study.yaml")
    digest = hashlib.sha256(f"{__version__} {task}".encode())
    files = sorted(path for path in folder.iterdir() if path.is_file() and path.suffix in _OF_RECORDINGS)
    for path in [*files, *map(Path, judged if task == "validation" else ())]:
        content = path.read_bytes()
        digest.update(f"{path.name} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()[:_KEY_DIGITS]


def _words(error: Exception) -> str:
    if isinstance(error, InsoleError):
        return str(error)
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return f"{type(error).__name__}: {error}"


def _report(recording: Recording, file: Path, judged: Sequence[Path]) -> None:
    from ..view.recorded import recorded_page

    write_text(file, recorded_page(recording))


def _steps(recording: Recording, file: Path, judged: Sequence[Path]) -> None:
    steps = recording.steps
    if not len(steps):
        raise InsoleError(f"no steps: {'; '.join(steps.remarks) or 'nobody walks'}")
    arrays = {f"column_{name}": column for name, column in steps.columns.items()}
    arrays |= {f"curve_{name}": curve for name, curve in steps.curves.items()}
    arrays |= {"start_ns": np.array(steps.start_ns), "remarks": np.array("\n".join(steps.remarks))}
    arrays["calibrations"] = np.array(json.dumps(steps.calibrations))
    with unfinished(file) as beside, open(beside, "wb") as handle:
        np.savez(handle, **arrays)  # type: ignore[arg-type]


def _validation(recording: Recording, file: Path, judged: Sequence[Path]) -> None:
    from ..calibration.validation import validate, validation_document
    from ..documents import Reading

    documents = []
    for path in judged:
        document = Reading(path).document
        foot = document.get("foot") if isinstance(document, dict) else None
        layout = next((side.layout for side in recording.feet if side.foot == foot), None)
        if layout is not None:
            results, _ = validate([recording], calibrations.load(path, layout))
            documents.append(validation_document(results, path.name))
    if not documents:
        raise InsoleError("no calibration of a recorded foot is listed under calibrations")
    write_text(file, json.dumps(documents, indent=1, ensure_ascii=False) + "\n")


def _diagnosis(recording: Recording, file: Path, judged: Sequence[Path]) -> None:
    documents = []
    for foot in recording.feet:
        with tempfile.TemporaryDirectory() as made:
            out = Path(made, "diagnosis")
            command = [sys.executable, "-c", "from insole_daemon.cli import main; main()", "diagnose"]
            side = ["--foot", foot.foot] if len(recording.feet) > 1 else []
            done = subprocess.run(
                [*command, str(recording.folder), "--out", str(out), *side], capture_output=True, text=True, check=False
            )
            if done.returncode not in _VERDICT_STATUSES:
                raise InsoleError((done.stderr.strip().splitlines() or ["no message"])[-1])
            documents.append({"foot": foot.foot, **json.loads((out / "diagnosis.json").read_text())})
    write_text(file, json.dumps(documents, indent=1, ensure_ascii=False) + "\n")


_DO: Mapping[Task, Callable[[Recording, Path, Sequence[Path]], None]] = {
    "report": _report,
    "steps": _steps,
    "validation": _validation,
    "diagnosis": _diagnosis,
}
