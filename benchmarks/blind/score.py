"""Scores the answers against the sealed truth: `python -m benchmarks.blind.score --help`."""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from benchmarks.blind import seal, tables, walking_tables
from benchmarks.blind.rules import judge
from benchmarks.blind.run import LOG
from benchmarks.blind.untouched import Compensator, Predictor, compare, compare_force, imported


def _judged(case: dict[str, Any], answer: Path) -> dict[str, Any]:
    """The case judged; an answer that is not there or is not what the contract says counts as none."""
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
    """Every case judged, and the tables made of them."""
    truth = seal.open_(sealed, printed)
    log = [json.loads(line) for line in (answers / LOG).read_text().splitlines()]
    by_case = {entry["case"]: entry for entry in log}
    rows = []
    for name, case in sorted(truth["cases"].items()):
        row = {"case": name, **_judged(case, answers / name), "variant": case["variant"]}
        row |= {"suite": case["suite"], "run": by_case.get(name)}
        model = answers / name / "model.json"
        if predict is not None and (case["suite"] == "chamber" or case["simulated"]):
            row["untouched"] = compare(sealed / name, case["foot"], model, predict)
        if compensate is not None and case["suite"] == "walking" and not case["simulated"]:
            row["force"] = compare_force(sealed / name, case["foot"], model, compensate)
        rows.append(row)
    chamber = [r for r in rows if r["suite"] == "chamber"]
    walking = [r for r in rows if r["suite"] == "walking"]
    found: dict[str, Any] = {"about": truth["about"], "seal": printed, "runs": tables.runs(rows), "cases": rows}
    found["tables"] = tables.tables(chamber) if chamber else None
    found["walking"] = walking_tables.tables(walking) if walking else None
    return found


def markdown(found: dict[str, Any]) -> str:
    """The whole score, for a README."""
    about = found["about"]
    head = f"Suite {about['suite']}, {about['cases']} cases, seed {about['seed']}, seal {found['seal']}. "
    parts = [head + "Rates with Wilson's 95 % interval.\n"]
    if found["tables"]:
        parts.append(tables.markdown(found["tables"]))
    if found["walking"]:
        parts.append(walking_tables.markdown(found["walking"]))
    return "\n".join([*parts, tables.runs_markdown(found["runs"])])


def main() -> None:
    ask = argparse.ArgumentParser(prog="python -m benchmarks.blind.score", description=__doc__)
    ask.add_argument("--sealed", type=Path, required=True)
    ask.add_argument("--answers", type=Path, required=True)
    ask.add_argument("--seal", required=True, help="what generate printed")
    ask.add_argument("--predictor", help="module:function(model_json, recording, simulation) -> {foot: counts}")
    ask.add_argument("--compensator", help="module:function(model_json, recording) -> {foot: (t_s, fz_n)}")
    ask.add_argument("--json", type=Path, help="also write everything, case by case, into this file")
    said = ask.parse_args()
    predict = imported(said.predictor) if said.predictor else None
    compensate = imported(said.compensator) if said.compensator else None
    try:
        found = score(said.sealed, said.answers, said.seal, predict, compensate)
    except seal.BrokenSealError as broken:
        raise SystemExit(str(broken)) from None
    if said.json:
        said.json.write_text(json.dumps(found, indent=1) + "\n")
    sys.stdout.write(markdown(found))


if __name__ == "__main__":
    main()
