"""`insole prove` from a checkout: the benchmark's programs, in their order, and all they leave."""

from __future__ import annotations

import json

from typer.testing import CliRunner

from insole_daemon.cli import app, prove
from insole_daemon.errors import FileError

RUNNER = CliRunner()


def test_a_case_from_seal_to_table(tmp_path):
    out = tmp_path / "proof"
    done = RUNNER.invoke(app, ["prove", "--cases", "1", "--suite", "bench", "--seed", "5", "--out", str(out)])
    assert done.exit_code == 0, done.output
    first, *rest = done.stdout.splitlines()
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
    done = RUNNER.invoke(app, ["prove", "--out", str(tmp_path)])
    assert isinstance(done.exception, FileError)
    assert "never overwritten" in str(done.exception)


def test_without_a_checkout_it_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setattr(prove, "__file__", str(tmp_path / "site" / "insole_daemon" / "cli" / "prove.py"))
    done = RUNNER.invoke(app, ["prove", "--out", str(tmp_path / "out")])
    assert isinstance(done.exception, FileError)
    assert "clone the repository" in str(done.exception)
    assert not (tmp_path / "out").exists()
