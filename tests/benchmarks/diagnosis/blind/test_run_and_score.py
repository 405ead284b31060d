"""The programs make, run and score one after the other, with small scripts in the place of the tool."""

import json
import sys

import numpy as np
import pytest
from distributed import LocalCluster

from benchmarks.diagnosis.blind import run as runner
from benchmarks.diagnosis.blind import seal
from benchmarks.diagnosis.blind.generate import generate
from benchmarks.diagnosis.blind.run import command_for, run
from benchmarks.diagnosis.blind.score import markdown, score
from benchmarks.diagnosis.blind.tables import bars
from benchmarks.diagnosis.blind.untouched import compare_force

N_CASES = 3
PERFECT_TOOL = """
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


def predictor(name, error_count=0.0):
    def predict(model, recording, simulation):
        with np.load(recording.parent / "scoring.npz") as scoring:
            out = np.zeros((len(scoring["untouched"]), 28, 12))
            out[scoring["untouched"]] = scoring[name] + error_count
        return {"left": out, "right": out}

    return predict


def bars_by_title(scores):
    return {b.title: b for b in bars(scores["cases"])}


def test_a_perfect_answer_scores_full_marks(generated, tmp_path):
    (tmp_path / "tool.py").write_text(PERFECT_TOOL)
    template = [sys.executable, str(tmp_path / "tool.py"), str(generated.sealed / "truth.json"), "{recording}", "{out}"]
    log = run(template, generated.cases, tmp_path / "answers", limit_s=60)
    assert [entry["status"] for entry in log] == [0] * N_CASES
    assert all(entry["peak_mb"] > 1 and entry["seconds"] > 0 for entry in log)
    scores = score(generated.sealed, tmp_path / "answers", generated.seal, predictor("oracle"))
    by_title = bars_by_title(scores)
    assert by_title["nulls, false alarms"].measured.startswith("0 % (0 of 1")
    assert by_title["single ≥ 3 × floor and faults: named first"].measured.startswith("100 % (1 of 1")
    assert by_title["paired simulation: named first"].measured.startswith("100 % (1 of 1")
    assert by_title["… swap or map right"].reached is True
    assert by_title["place, F1 per taxel, chamber"].reached is True
    assert by_title["parameters: median error"].reached is True
    assert by_title["untouched data made worse by > 2 %"].reached is True
    assert "| single ≥ 3 × floor and faults: named first | ≥ 95 % | 100 % (1 of 1" in markdown(scores)
    json.dumps(scores)
    worse_by_title = bars_by_title(
        score(generated.sealed, tmp_path / "answers", generated.seal, predictor("handed_out", 5.0))
    )
    assert worse_by_title["untouched data made worse by > 2 %"].measured.startswith("100 % (3 of 3")
    assert worse_by_title["recovered share of the oracle's gain, median"].reached is False


def test_a_run_that_fails_is_logged_and_scored_as_wrong(generated, tmp_path):
    log = run([sys.executable, "-c", "1 / 0"], generated.cases, tmp_path / "answers", limit_s=60)
    assert [(entry["status"], entry["traceback"]) for entry in log] == [(1, True)] * N_CASES
    by_title = bars_by_title(score(generated.sealed, tmp_path / "answers", generated.seal))
    assert by_title["nulls, false alarms"].measured.startswith("100 % (1 of 1")
    assert by_title["single ≥ 3 × floor and faults: named first"].measured.startswith("0 % (0 of 1")
    assert by_title["tracebacks, crashes and time-outs"].measured.startswith(f"100 % ({N_CASES} of {N_CASES}")


def test_unreadable_answer_counts_as_no_answer(generated, tmp_path):
    answers = tmp_path / "answers"
    run([sys.executable, "-c", ""], generated.cases, answers, limit_s=60)
    first, second, third = sorted(p.name for p in generated.cases.iterdir() if p.is_dir())
    (answers / first / "diagnosis.json").write_text("{")
    (answers / second / "diagnosis.json").write_text('{"format": "insole-diagnosis/1", "findings": [{}]}')
    scores = score(generated.sealed, answers, generated.seal)
    assert not any(row["answered"] for row in scores["cases"])
    reasons = {row["case"]: row["unreadable"] for row in scores["cases"]}
    assert "JSONDecodeError" in reasons[first]
    assert "KeyError: 'effect'" in reasons[second]
    assert "FileNotFoundError" in reasons[third]


def test_a_run_that_never_ends_is_stopped(generated, tmp_path):
    log = run([sys.executable, "-c", "import time; time.sleep(600)"], generated.cases, tmp_path / "a", limit_s=0.5)
    assert {entry["ended"] for entry in log} == {"stopped at the time limit"}


def test_an_interrupted_run_continues_where_it_stopped(generated, tmp_path, monkeypatch):
    answers, command = tmp_path / "answers", [sys.executable, "-c", "print(1)"]
    run_case, names_run = runner.run_case, []

    def stop_at_the_third(template, case, *arguments):
        if len(names_run) == 2:
            raise KeyboardInterrupt
        names_run.append(case.name)
        return run_case(template, case, *arguments)

    monkeypatch.setattr(runner, "run_case", stop_at_the_third)
    with pytest.raises(KeyboardInterrupt):
        run(command, generated.cases, answers, limit_s=60)
    header = json.loads((answers / "run.json").read_text())
    assert header["set"] == {"seed": 11, "suite": "bench", "cases": N_CASES, "seal": generated.seal}
    assert header["commit"]
    with (answers / "log.jsonl").open("a") as log:
        log.write('{"case": "cut o')
    monkeypatch.setattr(runner, "run_case", run_case)
    assert len(score(generated.sealed, answers, generated.seal)["cases"]) == 2
    assert [e["case"] for e in run(command, generated.cases, answers, limit_s=60)][:2] == names_run
    assert len(runner.read_log(answers)) == N_CASES
    with pytest.raises(SystemExit, match="was begun with command"):
        run([*command, "other"], generated.cases, answers, limit_s=60)


def test_the_workers_of_a_dask_scheduler_make_the_same_cases_and_run_each_once(generated, tmp_path):
    with LocalCluster(n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0") as workers:
        address = workers.scheduler_address
        generate(11, "bench", N_CASES, tmp_path / "cases", tmp_path / "sealed", address)
        truth, truth_by_dask = (
            (sealed / "truth.json").read_bytes() for sealed in (generated.sealed, tmp_path / "sealed")
        )
        assert truth == truth_by_dask, "with the SHA-256 of every file of every case"
        log = run([sys.executable, "-c", "print(1)"], tmp_path / "cases", tmp_path / "answers", 60, address)
        assert sorted(entry["case"] for entry in log) == sorted(p.name for p in generated.cases.iterdir() if p.is_dir())
        assert [entry["status"] for entry in log] == [0] * N_CASES
        with pytest.raises(SystemExit, match="name the tool's command after --"):
            run(["no-such-tool"], tmp_path / "cases", tmp_path / "other", 60, address)


def test_the_simulation_is_named_where_there_is_one(tmp_path):
    (tmp_path / "case" / "recording").mkdir(parents=True)
    template = ["tool", "{recording}", "{simulation}", "--out", "{out}"]
    case, out = tmp_path / "case", tmp_path / "out"
    assert command_for(template, case, out) == ["tool", str(case / "recording"), "--out", str(out)]
    (case / "simulation").mkdir()
    assert command_for(template, case, out)[2:4] == ["--simulation", str(case / "simulation")]


def test_a_truth_changed_afterwards_is_refused(generated, tmp_path):
    with pytest.raises(seal.BrokenSealError, match="expected the truth sealed as"):
        seal.open_(generated.sealed, "0" * 64)
    sealed_folder = tmp_path / "sealed"
    (sealed_folder / "case-1").mkdir(parents=True)
    (sealed_folder / "case-1" / "file").write_text("one")
    printed = seal.close(sealed_folder, {"case-1": {"kept_back": seal.digests(sealed_folder / "case-1")}}, {})
    assert seal.open_(sealed_folder, printed)["cases"]
    (sealed_folder / "case-1" / "file").write_text("two")
    with pytest.raises(seal.BrokenSealError, match="is not what was sealed"):
        seal.open_(sealed_folder, printed)


def test_force_is_compared_at_the_stated_times(tmp_path):
    t_s = 1.6e9 + np.arange(500) * 0.02
    force = 300 + 300 * np.sin(np.arange(500) * 0.1)
    noise = np.random.default_rng(4).standard_normal((2, 500))
    np.savez(
        tmp_path / "scoring.npz", t_s=t_s, fz_n=force, static_fz_n=force + 30 * noise[0], oracle_fz_n=force + noise[1]
    )

    def between_the_rows(model, recording):
        return {"left": (t_s[:-1] + 0.01, (force[:-1] + force[1:]) / 2 + 2.0)}

    errors = compare_force(tmp_path, "left", tmp_path / "model.json", between_the_rows)
    assert errors["model"] == pytest.approx(2.0, abs=0.05)
    assert errors["recovered"] == pytest.approx((30 - 2) / (30 - 1), abs=0.03)
    incomplete = compare_force(
        tmp_path, "left", tmp_path / "model.json", lambda m, r: {"left": (t_s[:100], force[:100])}
    )
    assert "expected a finite f_z" in incomplete["failure"]
