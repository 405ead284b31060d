"""The three programs one after the other, with stand-ins for the tool."""

import json
import sys

import numpy as np
import pytest

from benchmarks.blind import seal
from benchmarks.blind.run import command_for, run
from benchmarks.blind.score import markdown, score

PERFECT = """
import json, pathlib, sys
truth, recording, out = map(pathlib.Path, sys.argv[1:4])
case = json.loads(truth.read_text())["cases"][recording.parent.name]
findings = [
    {"effect": e["effect"], "alternatives": [], "where": e["where"], "confidence": 1.0,
     "parameters": {k: {"value": v, "std": [abs(x) * 0.01 for x in v]} for k, v in e["parameters"].items()},
     "amplitude_fraction": e["amplitude_fraction"]}
    for e in case["effects"]
]
answer = {"format": "insole-diagnosis/1", "verdict": "explained" if findings else "no mismatch", "findings": findings}
(out / "diagnosis.json").write_text(json.dumps(answer))
(out / "model.json").write_text("{}")
"""


def true_mean(model, recording, simulation):
    with np.load(recording.parent / "scoring.npz") as scoring:
        out = np.zeros((len(scoring["untouched"]), 28, 12))
        out[scoring["untouched"]] = scoring["mean"]
    return {"left": out, "right": out}


def five_counts_off(model, recording, simulation):
    with np.load(recording.parent / "scoring.npz") as scoring:
        out = np.zeros((len(scoring["untouched"]), 28, 12))
        out[scoring["untouched"]] = scoring["baseline"] + 5.0
    return {"left": out, "right": out}


def test_a_perfect_answer_scores_full_marks(made, tmp_path):
    (tmp_path / "tool.py").write_text(PERFECT)
    template = [sys.executable, str(tmp_path / "tool.py"), str(made.sealed / "truth.json"), "{recording}", "{out}"]
    log = run(template, made.cases, tmp_path / "answers", jobs=2, limit_s=60)
    assert [entry["status"] for entry in log] == [0, 0, 0]
    assert all(entry["peak_mb"] > 1 and entry["seconds"] > 0 for entry in log)
    found = score(made.sealed, tmp_path / "answers", made.seal, true_mean)
    t = found["tables"]
    assert t["nulls"]["rate"] == 0.0
    assert t["singles"]["rate"] == 1.0
    assert t["place"]["mean"] == 1.0
    assert t["parameters"]["median_error"] == 0.0
    assert t["untouched"]["recovered"]["median"] == pytest.approx(1.0)
    assert t["untouched"]["made_worse"] == []
    assert "| single effects named first | ≥ 95 % | 100 % (1 of 1" in markdown(found)
    json.dumps(found)
    worse = score(made.sealed, tmp_path / "answers", made.seal, five_counts_off)["tables"]["untouched"]
    assert len(worse["made_worse"]) == 3
    assert worse["recovered"]["median"] < 0


def test_a_run_that_fails_is_logged_and_scored_as_wrong(made, tmp_path):
    log = run([sys.executable, "-c", "raise SystemExit(4)"], made.cases, tmp_path / "answers", jobs=1, limit_s=60)
    assert [entry["status"] for entry in log] == [4, 4, 4]
    found = score(made.sealed, tmp_path / "answers", made.seal)
    t = found["tables"]
    assert t["answered"]["right"] == 0
    assert t["nulls"]["rate"] == 1.0
    assert t["singles"]["rate"] == 0.0
    assert found["runs"]["status"] == {"4": 3}


def test_an_answer_that_cannot_be_read_is_none(made, tmp_path):
    answers = tmp_path / "answers"
    run([sys.executable, "-c", ""], made.cases, answers, jobs=1, limit_s=60)
    first, second, third = sorted(p.name for p in made.cases.iterdir())
    (answers / first / "diagnosis.json").write_text("{")
    (answers / second / "diagnosis.json").write_text('{"format": "insole-diagnosis/1", "findings": [{}]}')
    found = score(made.sealed, answers, made.seal)
    assert found["tables"]["answered"]["right"] == 0
    said = {row["case"]: row["unreadable"] for row in found["cases"]}
    assert "JSONDecodeError" in said[first]
    assert "KeyError: 'effect'" in said[second]
    assert "FileNotFoundError" in said[third]


def test_a_run_that_never_ends_is_stopped(made, tmp_path):
    log = run([sys.executable, "-c", "import time; time.sleep(600)"], made.cases, tmp_path / "a", jobs=3, limit_s=0.5)
    assert {entry["ended"] for entry in log} == {"stopped at the time limit"}
    assert len((tmp_path / "a" / "log.jsonl").read_text().splitlines()) == 3


def test_the_simulation_is_named_where_there_is_one(tmp_path):
    (tmp_path / "case" / "recording").mkdir(parents=True)
    template = ["tool", "{recording}", "{simulation}", "--out", "{out}"]
    case, out = tmp_path / "case", tmp_path / "out"
    assert command_for(template, case, out) == ["tool", str(case / "recording"), "--out", str(out)]
    (case / "simulation").mkdir()
    assert command_for(template, case, out)[2:4] == ["--simulation", str(case / "simulation")]


def test_a_truth_changed_afterwards_is_refused(made, tmp_path):
    with pytest.raises(seal.BrokenSealError, match="expected the truth sealed as"):
        seal.open_(made.sealed, "0" * 64)
    kept = tmp_path / "sealed"
    kept.mkdir()
    (kept / "case-1").mkdir()
    (kept / "case-1" / "file").write_text("one")
    printed = seal.close(kept, {"case-1": {"kept_back": seal.digests(kept / "case-1")}}, {})
    assert seal.open_(kept, printed)["cases"]
    (kept / "case-1" / "file").write_text("two")
    with pytest.raises(seal.BrokenSealError, match="is not what was sealed"):
        seal.open_(kept, printed)
