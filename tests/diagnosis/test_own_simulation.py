"""`insole diagnose --simulate`: a chamber against the model's own simulation of its trial."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from insole_daemon.cli import app
from insole_daemon.errors import InsoleError, SimulationError, UndecidableError

from .chamber import relaxing, write

EXAMPLES = Path(__file__).parents[1] / "data" / "examples"


def diagnose(folder: Path, out: Path, *more: str) -> dict:
    done = CliRunner().invoke(app, ["diagnose", str(folder), "--out", str(out), "--simulate", *more])
    assert done.exit_code in (0, 1), done.output
    return json.loads((out / "diagnosis.json").read_text())


def refused(*arguments: str) -> InsoleError:
    done = CliRunner().invoke(app, ["diagnose", *arguments])
    assert isinstance(done.exception, InsoleError), done.output
    return done.exception


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("late") / "bag", relaxing(0.2, 1.2))


def test_an_insole_that_matches_its_calibration_has_no_finding(tmp_path):
    found = diagnose(write(tmp_path / "bag"), tmp_path / "out")
    assert (found["against"], found["verdict"], found["findings"]) == ("simulation", "no mismatch", [])
    assert (tmp_path / "out" / "simulation" / "recording.yaml").exists()


def test_simulated_with_the_reported_memory_nothing_more_is_reported(tmp_path, late):
    found = diagnose(late, tmp_path / "first")
    (named,) = found["findings"]
    assert (named["effect"], named["where"]["scope"]) == ("viscoelasticity", "insole")
    assert named["parameters"]["a"]["value"] == pytest.approx(0.2, abs=0.04)
    assert found["heldout"]["after"] < 1.1 * found["heldout"]["floor"] < 0.8 * found["heldout"]["before"]
    model = tmp_path / "first" / "model.json"
    again = diagnose(late, tmp_path / "again", "--calibration", str(model))
    assert (again["verdict"], again["findings"]) == ("no mismatch", [])
    kept = json.loads((tmp_path / "again" / "model.json").read_text())["effects"]
    assert kept == json.loads(model.read_text())["effects"]


def test_a_diagnosis_is_replaced_with_its_simulation(tmp_path):
    bag, out = write(tmp_path / "bag"), tmp_path / "out"
    diagnose(bag, out)
    log = out / "simulation" / "can.log"
    before = log.read_bytes()
    log.write_bytes(b"")
    assert "diagnosis is already there" in str(refused(str(bag), "--out", str(out), "--simulate"))
    diagnose(bag, out, "--force")
    assert log.read_bytes() == before


def test_a_recording_that_is_refused_leaves_no_simulation(tmp_path):
    error = refused(str(EXAMPLES / "chamber"), "--out", str(tmp_path / "out"), "--simulate")
    assert isinstance(error, UndecidableError)
    assert not (tmp_path / "out" / "simulation").exists()


def test_a_walk_is_refused(tmp_path):
    error = refused(str(EXAMPLES / "shoe"), "--out", str(tmp_path / "out"), "--simulate")
    assert isinstance(error, SimulationError)
    assert "do not determine the load of 280 taxels" in str(error)
    assert str(error).count(". ") == 0


def test_a_simulation_is_either_given_or_made():
    shoe = str(EXAMPLES / "shoe")
    done = CliRunner().invoke(app, ["diagnose", shoe, "--out", "out", "--simulate", "--simulation", shoe])
    assert done.exit_code == 2
    assert "--simulation" in done.output
