"""Scores answers against the sealed truth."""

import json
from pathlib import Path
from typing import Any

from . import seal, tables
from .rules import judge
from .run import HEADER, read_log
from .untouched import Compensator, Predictor, compare_counts, compare_force


def _judge_answer(case: dict[str, Any], answer: Path) -> dict[str, Any]:
    """Score the answer to one case; a file that is missing or does not follow formats.md counts as no answer."""
    try:
        diagnosis = json.loads((answer / "diagnosis.json").read_text())
        if diagnosis["format"] != "insole-diagnosis/1":
            raise ValueError(f"expected insole-diagnosis/1, found {diagnosis['format']!r}")
        return {**judge(case, diagnosis), "unreadable": None}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as problem:
        return {**judge(case, None), "unreadable": f"{type(problem).__name__}: {problem}"}


def score(
    sealed: Path,
    answers: Path,
    seal_sha256: str,
    predict: Predictor | None = None,
    compensate: Compensator | None = None,
) -> dict[str, Any]:
    """Score every case that was run; `seal_sha256` is the seal that `make` printed."""
    truth = seal.open_(sealed, seal_sha256)
    runs = {entry["case"]: entry for entry in read_log(answers)}
    header = answers / HEADER
    rows = []
    for name, case in sorted(truth["cases"].items()):
        if name not in runs:
            continue
        row = {"case": name, **_judge_answer(case, answers / name), "run": runs[name], "untouched": None}
        model, kept_back = answers / name / "model.json", sealed / name
        is_force_compared = case["recording"] == "walk" and case["against"] == "reference"
        if is_force_compared and compensate is not None:
            row["untouched"] = compare_force(kept_back, case["foot"], model, compensate)
        elif not is_force_compared and predict is not None:
            row["untouched"] = compare_counts(kept_back, case["foot"], model, predict)
        rows.append(row)
    return {
        "about": truth["about"],
        "seal": seal_sha256,
        "run": json.loads(header.read_text()) if header.exists() else None,
        "bars": [bar.cells() for bar in tables.bars(rows)],
        "cases": rows,
    }


def markdown(scores: dict[str, Any]) -> str:
    """The scores as a markdown page."""
    description, run = scores["about"], scores["run"]
    tool = f", tool of commit {run['commit']}" if run else ""
    return (
        f"Suite {description['suite']}, {len(scores['cases'])} of {description['cases']} cases, "
        f"seed {description['seed']}, seal {scores['seal']}{tool}. "
        "With 95 % intervals: Wilson's for rates, the bootstrap's for others.\n\n" + tables.markdown(scores["cases"])
    )
