"""The results of all recordings as one table, and all their steps as another: the same bytes from any workers."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import FileError
from ..files import unfinished, write_text
from ..mechanics.gait.intervals import mean_interval
from ..mechanics.gait.steps import Steps
from ..mechanics.gait.symmetry import symmetry
from ..recording.lab import need
from .document import Study
from .scheduling import results_of
from .tasks import TaskResult, describe_problems

FIGURES = ("stance_s", "swing_s", "stride_s", "double_support_s", "cadence_per_min", "peak_force_n", "impulse_n_s",
           "loading_rate_n_s", "cop_path_m", "cop_width_m", "contact_area_m2")  # fmt: skip
SYMMETRIES = ("stance_s", "peak_force_n", "impulse_n_s")


def load_steps(file: Path) -> Steps:
    """Return the steps that a worker wrote into `file`."""
    with np.load(file, allow_pickle=False) as archive:
        columns = {name.removeprefix("column_"): archive[name] for name in archive.files if name.startswith("column_")}
        curves = {name.removeprefix("curve_"): archive[name] for name in archive.files if name.startswith("curve_")}
        remarks = str(archive["remarks"])
        calibrations = json.loads(str(archive["calibrations"]))
        return Steps(columns, curves, int(archive["start_ns"]), tuple(remarks.splitlines()), calibrations)


def collect_rows(
    study: Study, results: Path, outcomes: Sequence[Sequence[TaskResult]]
) -> tuple[list[dict[str, Any]], list[Steps | None]]:
    """Return a row a recording, and its steps; None where it has none.

    `outcomes` are what became of the tasks of each recording, in the order of study.yaml.
    """
    rows, steps_of_recordings = [], []
    for recording, outcome in zip(study.recordings, outcomes, strict=True):
        place = results_of(results, recording.folder)
        files = {done.task: place / done.file for done in outcome if done.file is not None}
        row: dict[str, Any] = {
            "recording": str(recording.folder),
            "person": recording.person,
            "session": recording.session,
            "condition": recording.condition,
            "missing": describe_problems(outcome),
        }
        steps = load_steps(files["steps"]) if "steps" in files else None
        if steps is not None:
            row |= _gait(steps)
        if "validation" in files:
            row |= _validation(json.loads(files["validation"].read_text()))
        if "diagnosis" in files:
            row |= _diagnosis(json.loads(files["diagnosis"].read_text()))
        rows.append(row)
        steps_of_recordings.append(steps)
    return rows, steps_of_recordings


def _gait(steps: Steps) -> dict[str, Any]:
    row: dict[str, Any] = {"stances": len(steps), "remarks": "; ".join(steps.remarks)}
    for foot in ("left", "right"):
        steady = steps.of(foot).steady
        row[f"{foot}_steady_steps"] = len(steady)
        for name in FIGURES:
            interval = mean_interval(
                steady[name], float(np.nan_to_num(steady.std(name)).mean()) if len(steady) else 0.0
            )
            known = steady[name][np.isfinite(steady[name])]
            row |= {
                f"{foot}_{name}": interval.value,
                f"{foot}_{name}_sd": float(known.std(ddof=1)) if len(known) > 1 else np.nan,
                f"{foot}_{name}_low": interval.low,
                f"{foot}_{name}_high": interval.high,
            }
    for name in SYMMETRIES:
        index = symmetry(steps, name)
        row |= {
            f"symmetry_{name}_percent": index.value,
            f"symmetry_{name}_low": index.low,
            f"symmetry_{name}_high": index.high,
        }
    return row


def _validation(documents: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {
        f"validation_{document['foot']}": document.get("missing")
        or json.dumps(document["recordings"], sort_keys=True, ensure_ascii=False)
        for document in documents
    }


def _diagnosis(documents: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    row = {}
    for document in documents:
        row[f"diagnosis_{document['foot']}"] = document.get("missing") or document["verdict"]
        row[f"findings_{document['foot']}"] = " ".join(finding["effect"] for finding in document.get("findings", ()))
    return row


def write_tables(
    study: Study, rows: Sequence[Mapping[str, Any]], steps_of_recordings: Sequence[Steps | None], out: Path
) -> None:
    """Write table.csv and table.parquet, a row a recording, and steps.csv and steps.parquet, a row a stance."""
    pandas = need("pandas", "pandas", "a study")
    frames = []
    for recording, steps in zip(study.recordings, steps_of_recordings, strict=True):
        if steps is not None:
            frame = steps.to_dataframe()
            about = (("recording", str(recording.folder)), ("person", recording.person),
                     ("session", recording.session), ("condition", recording.condition))  # fmt: skip
            for at, (name, value) in enumerate(about):
                frame.insert(at, name, value)
            frames.append(frame)
    tables = {"table": pandas.DataFrame(rows), "steps": pandas.concat(frames) if frames else pandas.DataFrame()}
    for name, frame in tables.items():
        try:
            write_text(out / f"{name}.csv", frame.to_csv(index=False, float_format="%.9g", lineterminator="\n"))
            with unfinished(out / f"{name}.parquet") as beside:
                frame.to_parquet(beside, index=False, engine="pyarrow")
        except OSError as error:
            why = os.strerror(error.errno) if error.errno else error  # pyarrow has words of its own
            raise FileError(f"{out / name}: cannot be written: {why}") from error
