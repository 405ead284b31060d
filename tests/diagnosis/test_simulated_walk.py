"""A walk beside a simulated one of the same trial: who and where the taxels are, nulls, the model, bad input."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from insole_daemon import config as configs
from insole_daemon.cli import app
from insole_daemon.diagnosis import prediction, simulated
from insole_daemon.diagnosis.audit import audit
from insole_daemon.diagnosis.mapping import PLACE
from insole_daemon.errors import DiagnosisError
from insole_daemon.physics.effect import Where, effect
from insole_daemon.recording.loading import load
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.conditions import Conditions
from insole_daemon.simulation.trial import Trial

CONFIG = configs.load(None)
LAYOUT = load_layout(CONFIG.insoles[0])
SECONDS = 30.0
SWAP = tuple(tuple(each) for each in LAYOUT.identities[[3, 15]].tolist())


def walk(folder: Path, *effects, take: int = 1, scenario: str = "t4", seconds: float = SECONDS) -> Path:
    """The trial as a recording of an insole with these effects; another take has other noise."""
    chosen = {"left": tuple(effects)}
    trial = Trial(scenario, CONFIG, [LAYOUT], effects=chosen, conditions=Conditions(take=take), seed=11)
    trial.write(folder, seconds)
    return folder


@pytest.fixture(scope="module")
def plain(tmp_path_factory) -> Path:
    return walk(tmp_path_factory.mktemp("plain") / "simulation", take=0)


def looked(folder: Path, simulation: Path) -> simulated.Mapped:
    recording = load(folder)
    foot = recording.feet[0]
    fit = audit(foot, "walk", steps=True)
    return simulated.observe(
        recording, foot, fit.kept, fit.cycles, load(simulation), foot.calibration, lambda text: None
    )[1]


def test_nothing_is_found_where_nothing_is_and_the_model_tells_the_counts(tmp_path, plain):
    folder = walk(tmp_path / "walk")
    out = tmp_path / "out"
    done = CliRunner().invoke(app, ["diagnose", str(folder), "--simulation", str(plain), "--out", str(out)])
    assert done.exit_code == 0, done.output
    said = json.loads((out / "diagnosis.json").read_text())
    assert [each["sentence"] for each in said["findings"]] == []
    assert said["against"] == "simulation"
    assert "map_transform" not in [each["effect"] for each in said["not_identifiable"]]
    expected = prediction.of_folder(out / "model.json", folder, plain)["left"]
    left = load(folder).feet[0].counts - expected
    assert np.sqrt(np.nanmean(left**2)) < 1.2
    report = (out / "report.html").read_text()
    assert "were searched for the best single effect" in report


def test_a_map_that_lies_askew(tmp_path, plain):
    askew = effect("map_transform", Where(), x_mm=5.0, y_mm=-3.0, rotation_deg=2.0, scale=1.0)
    mapped = looked(walk(tmp_path / "walk", askew), plain)
    assert mapped.askew
    assert not mapped.swaps
    x, y, turned, log_scale = mapped.theta[PLACE]
    assert (x, y) == pytest.approx((5.0, -3.0), abs=1.0)
    assert turned == pytest.approx(2.0, abs=0.2)
    assert log_scale == pytest.approx(0.0, abs=0.02)


def test_beyond_the_end_of_a_simulation_the_walk_is_foretold_to_go_on(tmp_path):
    short, folder = walk(tmp_path / "simulation", take=0, seconds=17.2), walk(tmp_path / "walk", seconds=18.0)
    foot = load(folder).feet[0]
    (calibration,) = folder.glob("*calibration*")
    expected = prediction.of_folder(calibration, folder, short)["left"]
    assert np.isfinite(expected[:, :, :6]).all()
    t_s = (foot.t_ns - foot.t_ns[0]) * 1e-9
    after, moment = t_s > 17.3, np.searchsorted(t_s, 17.1)
    left = np.sqrt(np.nanmean((foot.counts - expected)[after] ** 2))
    still = np.sqrt(np.nanmean((foot.counts - expected[moment])[after] ** 2))
    assert left < 0.6 * still, (left, still)


def test_triangles_that_are_each_other(tmp_path, plain):
    folder, out = walk(tmp_path / "walk", effect("swapped_triangles", Where(), pair=SWAP)), tmp_path / "out"
    done = CliRunner().invoke(app, ["diagnose", str(folder), "--simulation", str(plain), "--out", str(out)])
    assert done.exit_code == 0, done.output
    (found,) = json.loads((out / "diagnosis.json").read_text())["findings"]
    assert found["effect"] == "swapped_triangles"
    assert found["where"] == {"scope": "triangle", "ids": [list(each) for each in SWAP]}
    assert found["parameters"]["pair"]["value"] == [list(each) for each in SWAP]
    assert found["confidence"] > 0.95
    (effect_of_model,) = json.loads((out / "model.json").read_text())["effects"]
    assert effect_of_model["effect"] == "swapped_triangles"


def test_an_answer_that_comes_late_is_no_map_that_lies_askew(tmp_path, plain):
    mapped = looked(walk(tmp_path / "walk", effect("viscoelasticity", Where(), a=0.15, tau_s=0.3)), plain)
    assert not mapped.askew
    assert not mapped.swaps


def test_what_all_taxels_share_and_none_shows_clearly_is_named_for_the_whole_insole(tmp_path, plain):
    folder = walk(tmp_path / "walk", effect("viscoelasticity", Where(), a=0.12, tau_s=0.4))
    out = tmp_path / "out"
    arguments = ["diagnose", str(folder), "--simulation", str(plain), "--out", str(out), "--budget", "1"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    (found,) = json.loads((out / "diagnosis.json").read_text())["findings"]
    assert found["effect"] == "viscoelasticity"
    assert found["where"] == {"scope": "insole", "ids": []}
    assert found["parameters"]["a"]["value"] == pytest.approx(0.12, abs=0.02)
    assert found["parameters"]["tau_s"]["value"] == pytest.approx(0.4, rel=0.25)


@pytest.mark.parametrize(("scenario", "seconds"), [("t1", SECONDS), ("t4", 10.0)])
def test_a_simulation_of_another_trial_or_duration(tmp_path, plain, scenario, seconds):
    other = walk(tmp_path / "other", scenario=scenario, seconds=seconds)
    with pytest.raises(DiagnosisError) as refused:
        looked(plain, other)
    assert "other" in str(refused.value)


def test_a_simulation_of_another_layout(tmp_path, plain):
    other = tmp_path / "other"
    shutil.copytree(plain, other)
    (path,) = other.glob("*layout*")
    text = path.read_text()
    path.write_text(text.replace("x_mm: 17", "x_mm: 18", 1))
    with pytest.raises(DiagnosisError, match="layout"):
        looked(plain, other)
