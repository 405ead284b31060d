"""Scores the answers against the sealed truth: `python -m benchmarks.blind.score --help`."""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from benchmarks.blind import seal, tables
from benchmarks.blind.rules import judge
from benchmarks.blind.run import LOG
from benchmarks.blind.untouched import Predictor, compare, predictor


def _diagnosis(answer: Path) -> dict[str, Any] | None:
    try:
        found = json.loads((answer / "diagnosis.json").read_text())
    except (OSError, ValueError):
        return None
    return found if found.get("format") == "insole-diagnosis/1" else None


def score(sealed: Path, answers: Path, printed: str, predict: Predictor | None) -> dict[str, Any]:
    """Every case judged, and the tables made of them."""
    truth = seal.open_(sealed, printed)
    log = [json.loads(line) for line in (answers / LOG).read_text().splitlines()]
    by_case = {entry["case"]: entry for entry in log}
    rows = []
    for name, case in sorted(truth["cases"].items()):
        row = {"case": name, **judge(case, _diagnosis(answers / name)), "variant": case["variant"]}
        row["run"] = by_case.get(name)
        if predict is not None:
            row["untouched"] = compare(sealed / name, case["foot"], answers / name / "model.json", predict)
        rows.append(row)
    return {"about": truth["about"], "seal": printed, "tables": tables.tables(rows), "cases": rows}


def main() -> None:
    ask = argparse.ArgumentParser(prog="python -m benchmarks.blind.score", description=__doc__)
    ask.add_argument("--sealed", type=Path, required=True)
    ask.add_argument("--answers", type=Path, required=True)
    ask.add_argument("--seal", required=True, help="what generate printed")
    ask.add_argument("--predictor", help="module:function(model_json, recording, simulation) -> {foot: counts}")
    ask.add_argument("--json", type=Path, help="also write everything, case by case, into this file")
    said = ask.parse_args()
    try:
        found = score(said.sealed, said.answers, said.seal, predictor(said.predictor) if said.predictor else None)
    except seal.BrokenSealError as broken:
        raise SystemExit(str(broken)) from None
    if said.json:
        said.json.write_text(json.dumps(found, indent=1) + "\n")
    sys.stdout.write(tables.markdown(found))


if __name__ == "__main__":
    main()
