"""`insole demo --hide`: what was concealed is said only after the diagnosis, and nothing a diagnosis reads tells it."""

from __future__ import annotations

import re

import pytest
from typer.testing import CliRunner

from insole_daemon.cli import app
from insole_daemon.errors import SimulationError

RUNNER = CliRunner()
LIVE = re.compile(r"^The daemon on .*: (pressure|f_z) off by ([\d.]+) (kPa|N) with the calibration, ([\d.]+) ", re.M)


def hide(*arguments: str) -> tuple[str, float, float]:
    """What is printed, and the daemon's error before and after."""
    done = RUNNER.invoke(app, ["demo", "--hide", *arguments])
    assert done.exit_code == 0, done.output
    match = LIVE.search(done.stdout)
    assert match is not None, done.stdout
    return done.output, float(match[2]), float(match[4])


def test_a_concealed_effect_is_diagnosed_and_then_printed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    output, before, after = hide("gain", "--seed", "7")
    assert "What was concealed: gain on board 7: gain 0.7745" in output
    assert "(seed 7); named first: gain" in output
    assert output.index("diagnosis.json") < output.index("What was concealed")
    assert "next: open concealed-7/diagnosis/report.html" in output
    assert (tmp_path / "concealed-7" / "diagnosis" / "model.json").exists()
    assert after < 0.5 * before


@pytest.mark.parametrize(
    ("word", "trial", "most"),
    [("viscoelasticity", "walk", 0.5), ("preload", "walk", 0.5), ("swapped_triangles", "walk", 1.05)],
)
def test_the_daemons_error_falls_by_the_model_of_what_was_concealed(tmp_path, monkeypatch, word, trial, most):
    monkeypatch.chdir(tmp_path)
    _, before, after = hide(word, "--in", trial, "--seed", "7")
    assert after < most * before


def test_effects_without_live_compensation_are_listed_with_the_reason(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    output, _, _ = hide("drift", "--in", "walk", "--seed", "7")
    assert "drift is not undone live: its times are those of a recording of another day" in output


def test_an_effect_that_a_chamber_cannot_show_is_refused_with_the_list(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = RUNNER.invoke(app, ["demo", "--hide", "crosstalk", "--in", "chamber"])
    assert isinstance(done.exception, SimulationError)
    assert done.exception.exit_status == 2
    assert "hysteresis, snap" in str(done.exception)
    assert "conceal it in a walk" in str(done.exception)
    assert not list(tmp_path.iterdir())


def test_an_unknown_word_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = RUNNER.invoke(app, ["demo", "--hide", "rust"])
    assert isinstance(done.exception, SimulationError)
    assert "found 'rust'" in str(done.exception)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("others", [["--seconds", "2"], ["--view"]])
def test_hide_refuses_options_of_the_live_demo(others):
    assert RUNNER.invoke(app, ["demo", "--hide", "gain", *others]).exit_code == 2


@pytest.mark.parametrize("others", [["--seed", "1"], ["--in", "walk"]])
def test_a_seed_or_a_trial_alone_is_refused(others):
    assert RUNNER.invoke(app, ["demo", *others]).exit_code == 2
