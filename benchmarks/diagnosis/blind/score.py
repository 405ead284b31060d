"""Scores answers against the sealed truth."""

import json
from pathlib import Path
from typing import Any

from . import seal, tables
from .rules import judge
from .run import HEADER, read_log
from .untouched import Compensator, Predictor, compare, compare_force


def _judged(case: dict[str, Any], answer: Path) -> dict[str, Any]:
    """The case judged; an answer that is missing or does not follow formats.md counts as none."""
    try:
        diagnosis = json.loads((answer / "diagnosis.json").read_text())
        if diagnosis["format"] != "insole-diagnosis/1":
            raise ValueError(f"expected insole-diagnosis/1, found {diagnosis['format']!r}")
        return {**judge(case, diagnosis), "unreadable": None}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as problem:
        return {**judge(case, None), "unreadable": f"{type(problem).__name__}: {problem}"}


def score(
    sealed: Path, answers: Path, printed: str, predict: Predictor | None = None, compensate: Compensator | None = None
) -> dict[str, Any]:
    """Every case judged; cases that were not run yet are left out."""
    truth = seal.open_(sealed, printed)
    by_case = {entry["case"]: entry for entry in read_log(answers)}
    header = answers / HEADER
    rows = []
    for name, case in sorted(truth["cases"].items()):
        if name not in by_case:
            continue
        row = {"case": name, **_judged(case, answers / name), "run": by_case[name], "untouched": None}
        model, kept = answers / name / "model.json", sealed / name
        by_force = case["recording"] == "walk" and case["against"] == "reference"
        if by_force and compensate is not None:
            row["untouched"] = compare_force(kept, case["foot"], model, compensate)
        elif not by_force and predict is not None:
            row["untouched"] = compare(kept, case["foot"], model, predict)
        rows.append(row)
    return {
        "about": truth["about"],
        "seal": printed,
        "run": json.loads(header.read_text()) if header.exists() else None,
        "bars": [b.cells() for b in tables.bars(rows)],
        "cases": rows,
    }


def markdown(found: dict[str, Any]) -> str:
    """The whole score, for a page of results."""
    about, run = found["about"], found["run"]
    tool = f", tool of commit {run['commit']}" if run else ""
    return (
        f"Suite {about['suite']}, {len(found['cases'])} of {about['cases']} cases, seed {about['seed']}, "
        f"seal {found['seal']}{tool}. With 95 % intervals: Wilson's for rates, the bootstrap's for others.\n\n"
        + tables.markdown(found["cases"])
    )
