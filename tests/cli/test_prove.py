"""`insole prove` runs the benchmark's programs in order and keeps their files."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from insole_daemon.cli import app, prove
from insole_daemon.errors import FileError

RUNNER = CliRunner()
INSOLE = Path(sys.executable).with_name("insole")
ROOT = Path(__file__).parents[2]


def test_a_case_from_seal_to_table_on_dask_workers(tmp_path):
    out = tmp_path / "proof"
    command = [INSOLE, "prove", "--cases", "1", "--suite", "bench", "--seed", "5", "--jobs", "2", "--out", out]
    result = subprocess.run([*map(str, command)], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    first, *rest = result.stdout.splitlines()
    assert first.startswith("Seal: ")
    assert len(first.removeprefix("Seal: ")) == 64
    assert "\n".join(rest) + "\n" == (out / "tables.md").read_text()
    assert "seed 5" in rest[0]
    (run,) = map(json.loads, (out / "answers" / "log.jsonl").read_text().splitlines())
    assert run["status"] in (0, 1, 3)
    (row,) = json.loads((out / "score.json").read_text())["cases"]
    assert row["unreadable"] is None
    assert row["untouched"]["model"] > 0


def test_runs_are_never_overwritten(tmp_path):
    result = RUNNER.invoke(app, ["prove", "--out", str(tmp_path)])
    assert isinstance(result.exception, FileError)
    assert "never overwritten" in str(result.exception)


def test_a_scheduler_beyond_loopback_needs_tls(tmp_path):
    result = RUNNER.invoke(app, ["prove", "--out", str(tmp_path / "proof"), "--scheduler", "tcp://10.0.0.5:8786"])
    assert "Dask exchanges pickles" in str(result.exception)
    assert not (tmp_path / "proof").exists()


@pytest.mark.parametrize("verb", [["prove", "--out"], ["study"]], ids=lambda verb: verb[0])
def test_a_certificate_without_its_key_is_refused(tmp_path, verb):
    walk = "{folder: walk, person: a, session: b, condition: c}"
    (tmp_path / "study.yaml").write_text(f"format: insole-study/1\nrecordings: [{walk}]\n")
    folder = tmp_path if verb == ["study"] else tmp_path / "proof"
    result = RUNNER.invoke(app, [*verb, str(folder), "--scheduler", "tls://10.0.0.5:8786", "--tls-cert", "my.pem"])
    assert result.exit_code == 2, result.output
    assert "needs all three" in result.output
    assert not (tmp_path / "proof").exists()


def test_without_a_checkout_the_benchmark_of_the_wheel_runs(tmp_path, monkeypatch):
    shutil.copytree(ROOT / "benchmarks" / "diagnosis" / "blind", tmp_path / "insole_blind")
    monkeypatch.setattr(prove, "__file__", str(tmp_path / "insole_daemon" / "cli" / "prove.py"))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert prove._benchmark() == ("insole_blind", None)
    assert "--sealed" in prove._run(lambda share: None, "make", "--help")


def test_the_wheel_is_built_with_the_benchmark():
    document = tomllib.loads((ROOT / "pyproject.toml").read_text())
    included = document["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    assert included == {"benchmarks/diagnosis/blind": "insole_blind"}
