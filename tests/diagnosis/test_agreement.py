"""Recordings that contradict each other are named, and do not bend what the others say."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

import insole_daemon
from insole_daemon.cli import app
from insole_daemon.diagnosis import diagnosing
from insole_daemon.diagnosis.agreement import foretold
from insole_daemon.diagnosis.candidates import candidates
from insole_daemon.diagnosis.diagnosing import Diagnosis, diagnose

from .chamber import bouc_wen, relaxing, write

SOLID = relaxing(0.3, 0.8)


@pytest.fixture(autouse=True)
def _three_candidates(monkeypatch):
    """The search among all of them takes minutes where nothing fits at first."""

    def some(excitation):
        return {word: candidates(excitation)[word] for word in ("hysteresis", "viscoelasticity", "temperature")}

    monkeypatch.setattr(diagnosing, "candidates", some)


def found(*folders) -> Diagnosis:
    return diagnose([insole_daemon.load(folder) for folder in folders], None, None, lambda text: None)


def test_an_effect_that_one_recording_does_not_show(tmp_path):
    folders = [write(tmp_path / name, SOLID, seconds=40.0) for name in ("monday", "tuesday")]
    folders.append(write(tmp_path / "friday", seconds=40.0))
    diagnosis = found(*folders)
    (finding,) = diagnosis.findings
    assert finding.effect == "viscoelasticity"
    assert finding.recordings == ("monday", "tuesday")
    assert finding.contradicted_by == ("friday",)
    assert "friday" in finding.sentence
    assert finding.parameters["a"].value == pytest.approx(0.3, rel=0.1)
    assert diagnosis.verdict == "explained"
    assert [each["effect"] for each in diagnosis.model["effects"]] == ["viscoelasticity"]
    # What the others know of the physics foretells each one that shows it.
    monday, tuesday, friday = foretold(diagnosis.located.named[0])
    for each in (monday, tuesday):
        assert each.after < 0.2 * each.before
    assert friday.after == friday.before


def test_two_recordings_with_physics_of_their_own(tmp_path):
    solid = write(tmp_path / "solid", SOLID, seconds=40.0)
    loop = write(tmp_path / "loop", bouc_wen(0.3, 60e3), seconds=40.0)
    done = CliRunner().invoke(app, ["diagnose", str(solid), str(loop), "--out", str(tmp_path / "out")])
    findings = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["findings"]
    by_word = {each["effect"]: (each["recordings"], each["contradicted_by"]) for each in findings}
    assert by_word == {"viscoelasticity": (["solid"], ["loop"]), "hysteresis": (["loop"], ["solid"])}
    (told,) = [line for line in done.stdout.splitlines() if line.startswith("  viscoelasticity")]
    assert told.endswith("[solid]")
