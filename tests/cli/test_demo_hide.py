"""`insole demo --hide`: what was concealed is said only after the diagnosis, and nothing a diagnosis reads tells it."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from insole_daemon.cli import app
from insole_daemon.errors import SimulationError

RUNNER = CliRunner()


def test_a_concealed_effect_is_diagnosed_and_then_printed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = RUNNER.invoke(app, ["demo", "--hide", "gain", "--seed", "7"])
    assert done.exit_code == 0, done.output
    *_, before, last = done.stdout.splitlines()
    assert last.startswith("What was concealed: gain on board 7: gain 0.7745")
    assert last.endswith("(seed 7); named first: gain")
    assert "diagnosis.json" in before
    assert "next: open concealed-7/diagnosis/report.html" in done.stderr
    assert (tmp_path / "concealed-7" / "diagnosis" / "model.json").exists()


def test_an_effect_that_a_chamber_cannot_show_is_refused_with_the_list(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = RUNNER.invoke(app, ["demo", "--hide", "crosstalk"])
    assert isinstance(done.exception, SimulationError)
    assert done.exception.exit_status == 2
    assert "hysteresis, snap" in str(done.exception)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("others", [["--seconds", "2"], ["--view"]])
def test_options_of_the_live_demo_do_not_go_with_it(others):
    assert RUNNER.invoke(app, ["demo", "--hide", "gain", *others]).exit_code == 2


def test_a_seed_alone_is_refused():
    assert RUNNER.invoke(app, ["demo", "--seed", "1"]).exit_code == 2
