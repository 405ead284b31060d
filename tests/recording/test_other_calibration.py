"""A recording analysed with another calibration than its own, such as the model of a diagnosis."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest

import insole_daemon
from benchmarks.gait.walk import compare
from insole_daemon.cli import main
from insole_daemon.config import Config
from insole_daemon.errors import InsoleError
from insole_daemon.physics.effect import effect
from insole_daemon.physics.effects_document import document
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.trial import Trial

CONFIG = Config()
LAYOUTS = [load_layout(insole) for insole in CONFIG.insoles]
SECONDS = 12.0
EFFECTS = [
    effect("creep", a=[0.04, 0.03], tau_s=[0.6, 8.0]),
    effect("hysteresis", r_pa=[2000.0, 15000.0], w=[0.04, 0.06]),
    effect("delay", delay_s=0.02),
]


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    """A walk on insoles with EFFECTS, the person, and for each foot its calibration with them."""
    folder = tmp_path_factory.mktemp("trial")
    trial = Trial("t4", CONFIG, LAYOUTS, effects={layout.foot: EFFECTS for layout in LAYOUTS}, seed=8)
    trial.write(folder / "walk", SECONDS)
    models = [write_model(folder, foot, EFFECTS) for foot in ("left", "right")]
    return folder / "walk", trial.load, models


def write_model(folder, foot, effects):
    calibration = json.loads((folder / "walk" / f"{foot}-calibration.json").read_text())
    calibration["effects"] = document(effects, LAYOUTS[foot == "right"])
    model = folder / f"{foot}-model.json"
    model.write_text(json.dumps(calibration))
    return model


def run_insole(monkeypatch, *words):
    monkeypatch.setattr(sys, "argv", ["insole", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code


def test_steps_with_the_true_effects_are_within_10_ms_and_1_percent(walked):
    folder, person, models = walked
    errors_s, ratios = compare(insole_daemon.load(folder).steps, person, SECONDS)
    assert np.sqrt(np.mean(np.square(errors_s))) > 0.018
    assert np.mean(ratios["impulse_n_s"]) < 0.99
    errors_s, ratios = compare(insole_daemon.load(folder, models).steps, person, SECONDS)
    assert np.sqrt(np.mean(np.square(errors_s))) < 0.010
    assert np.mean(ratios["impulse_n_s"]) == pytest.approx(1.0, abs=0.01)
    assert np.mean(ratios["peak_force_n"]) == pytest.approx(1.0, abs=0.01)


def test_one_calibration_replaces_that_of_its_foot_alone(walked):
    folder, _, models = walked
    own, replaced = insole_daemon.load(folder), insole_daemon.load(folder, models[:1])
    assert not np.array_equal(own["left"].pressure_pa, replaced["left"].pressure_pa, equal_nan=True)
    assert np.array_equal(own["right"].pressure_pa, replaced["right"].pressure_pa, equal_nan=True)
    assert own.steps.calibrations["left"] != replaced.steps.calibrations["left"], "other effects are other errors"
    assert own.steps.calibrations["right"] == replaced.steps.calibrations["right"]


def test_an_exported_mcap_has_the_calibration_it_was_exported_with(walked, tmp_path, monkeypatch):
    folder, _, models = walked
    options = [word for model in models for word in ("--calibration", str(model))]
    run_insole(monkeypatch, "export", folder, tmp_path / "walk.mcap", *options)
    run_insole(monkeypatch, "import", tmp_path / "walk.mcap", tmp_path / "again")
    expected, again = insole_daemon.load(folder, models), insole_daemon.load(tmp_path / "again")
    for foot in ("left", "right"):
        assert np.array_equal(expected[foot].pressure_pa, again[foot].pressure_pa, equal_nan=True)


def test_a_map_that_the_calibration_corrects_moves_the_cop_of_the_steps(walked, tmp_path):
    folder, _, _ = walked
    (tmp_path / "walk").symlink_to(folder)
    shifted = effect("map_transform", x_mm=0.0, y_mm=5.0, rotation_deg=0.0, scale=1.0)
    model = write_model(tmp_path, "left", [shifted])
    own, moved = (insole_daemon.load(folder, files).steps.of("left").steady for files in ((), [model]))
    difference_m = abs(np.mean(moved["cop_mean_y_m"]) - np.mean(own["cop_mean_y_m"]))
    assert difference_m == pytest.approx(0.005, abs=1e-4)


def test_calibrations_that_do_not_fit_are_refused_with_file_and_reason(walked, tmp_path):
    folder, _, models = walked
    with pytest.raises(InsoleError, match=r"left-model.json: the left foot has a calibration already"):
        insole_daemon.load(folder, [models[0], models[0]])
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(InsoleError, match=r"other.json: expected a calibration, insole-calibration/1, with its foot"):
        insole_daemon.load(folder, [tmp_path / "other.json"])
    one_foot = Trial("t4", Config(insoles=CONFIG.insoles[:1]), LAYOUTS[:1], seed=8).write(tmp_path / "left", 3.0)
    with pytest.raises(InsoleError, match=r"right-model.json: a calibration of the right foot, which .* does not have"):
        insole_daemon.load(one_foot, models)
    with pytest.raises(InsoleError, match=r"missing.json"):
        insole_daemon.load(folder, [tmp_path / "missing.json"])
