"""A chamber and a force shoe of one insole, diagnosed together: confirmation and contradiction."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from insole_daemon.cli import app
from insole_daemon.diagnosis.compensation import of_walk
from insole_daemon.errors import DiagnosisError
from insole_daemon.recording.loading import load

from . import chamber
from .chamber import Array, Sensors, relaxing
from .foot import shoe

SEED = 1
SENSORS = Sensors.drawn(np.random.default_rng(SEED))  # as `chamber.write` draws them


def bag(folder: Path, effect=lambda t_s, p: p) -> Path:
    return chamber.write(folder / "bag", effect, seconds=60.0, seed=SEED)


def walk(folder: Path, effect=lambda p: p, **options) -> Path:
    return shoe.write(folder / "walk", effect, seconds=20.0, sensors=SENSORS, **options)


def solid(p: Array) -> Array:
    return 0.7 * p + 0.3 * shoe.late(p, 0.8)


def diagnose(out: Path, *folders: Path) -> dict:
    done = CliRunner().invoke(app, ["diagnose", *map(str, folders), "--out", str(out)])
    assert done.exit_code == 0, (done.output, done.exception)
    return json.loads((out / "diagnosis.json").read_text())


def off_n(model: Path, folder: Path) -> float:
    """RMS by which the force of `model`, live, is off."""
    reference = load(folder).feet[0].reference
    t_s, f_z_n = of_walk(model, folder)["left"]
    return float(np.sqrt(np.mean((f_z_n - np.interp(t_s, reference.time_s, reference["fz_n"])) ** 2)))


def test_an_effect_in_chamber_and_walk_is_one_finding_and_one_of_the_walk_alone_another(tmp_path):
    folders = bag(tmp_path, relaxing(0.3, 0.8)), walk(tmp_path, solid, delay_s=0.03)
    found = diagnose(tmp_path / "out", *folders)
    assert found["verdict"] == "explained"
    assert found["recordings"] == ["bag", "walk"]
    by_word = {each["effect"]: each for each in found["findings"]}
    assert set(by_word) == {"viscoelasticity", "delay"}, [each["sentence"] for each in found["findings"]]
    assert by_word["viscoelasticity"]["recordings"] == ["bag", "walk"]
    assert by_word["viscoelasticity"]["contradicted_by"] == []
    assert by_word["viscoelasticity"]["parameters"]["a"]["value"] == pytest.approx(0.3, rel=0.1)
    assert by_word["delay"]["recordings"] == ["walk"]
    assert by_word["delay"]["parameters"]["delay_s"]["value"] == pytest.approx(0.03, abs=0.004)
    assert found["heldout"]["unit"] == "count"
    assert found["heldout"]["f_z"]["after"] < 0.3 * found["heldout"]["f_z"]["before"]
    words = {each["effect"] for each in found["not_identifiable"]}
    assert "crosstalk" in words
    assert "creep" not in words  # the chamber would have told it
    assert [each["recording"] for each in found["alignment"]] == ["bag", "walk"]
    model = tmp_path / "out" / "model.json"
    assert [each["effect"] for each in json.loads(model.read_text())["effects"]] == ["viscoelasticity", "delay"]
    assert off_n(model, folders[1]) < 0.4 * off_n(folders[1] / "calibration.json", folders[1])
    report = (tmp_path / "out" / "report.html").read_text()
    assert "held out: bag" in report
    assert "held out: walk" in report


def test_a_walk_that_contradicts_the_chamber_is_named_and_the_model_lacks_the_effect(tmp_path):
    found = diagnose(tmp_path / "out", bag(tmp_path, relaxing(0.3, 0.8)), walk(tmp_path))
    (finding,) = found["findings"]
    assert finding["effect"] == "viscoelasticity"
    assert finding["recordings"] == ["bag"]
    assert finding["contradicted_by"] == ["walk"]
    assert json.loads((tmp_path / "out" / "model.json").read_text())["effects"] == []


def test_a_chamber_that_contradicts_the_walk_is_named(tmp_path):
    found = diagnose(tmp_path / "out", walk(tmp_path, solid), bag(tmp_path))
    (finding,) = found["findings"]
    assert finding["effect"] == "viscoelasticity"
    assert finding["recordings"] == ["walk"]
    assert finding["contradicted_by"] == ["bag"]


def test_a_null_has_no_finding(tmp_path):
    stands = shoe.write(tmp_path / "stands", seconds=12.0, sensors=SENSORS, stands_s=11.0, clock="own")
    found = diagnose(tmp_path / "out", bag(tmp_path), stands, walk(tmp_path))
    assert [each["sentence"] for each in found["findings"]] == []
    assert found["verdict"] == "no mismatch"


def test_the_model_of_one_recording_is_verified_on_others(tmp_path):
    first = bag(tmp_path, relaxing(0.3, 0.8))
    for new, unit in ((walk(tmp_path, solid), "N"), (bag(tmp_path / "new", relaxing(0.3, 0.8)), "count")):
        if unit == "count":
            new = new.rename(tmp_path / "another")
        out = tmp_path / f"out-{unit}"
        done = CliRunner().invoke(app, ["diagnose", str(first), "--out", str(out), "--verify", str(new)])
        assert done.exit_code == 0, (done.output, done.exception)
        said = json.loads((out / "verification.json").read_text())
        assert (said["recording"], said["unit"]) == (new.name, unit)
        assert said["after"] < 0.7 * said["before"]
        assert f"verified on {new.name}: {said['before']:.2f} → {said['after']:.2f}" in done.output


def test_a_recording_that_the_model_is_made_of_is_refused_for_verification(tmp_path):
    only = bag(tmp_path, relaxing(0.3, 0.8))
    done = CliRunner().invoke(app, ["diagnose", str(only), "--out", str(tmp_path / "out"), "--verify", str(only)])
    assert isinstance(done.exception, DiagnosisError)
    assert "verify on another recording" in str(done.exception)


def loop(p: Array) -> Array:
    """Return half of `p` (N, m) and plays of 48 and 96 kPa, from rest: Prandtl's law."""
    out = 0.5 * p
    for share, radius_pa in ((0.3, 48e3), (0.2, 96e3)):
        state = np.zeros(p.shape[1:])
        for i, now in enumerate(p):
            state = np.clip(state, now - radius_pa, now + radius_pa)
            out[i] += share * state
    return out


def test_a_preload_beside_a_strong_loop_shows_once_the_walk_is_read_by_the_model_of_the_chamber(tmp_path):
    folders = bag(tmp_path, lambda t_s, p: loop(p)), walk(tmp_path, lambda p: loop(p + 6e3))
    done = CliRunner().invoke(app, ["diagnose", *map(str, folders), "--out", str(tmp_path / "out")])
    assert done.exit_code in (0, 3), (done.output, done.exception)  # 3: not decidable
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    hysteresis, constant = found["findings"]
    assert hysteresis["effect"] == "hysteresis"
    assert hysteresis["recordings"] == ["bag", "walk"]
    assert hysteresis["contradicted_by"] == []
    # Straight curves cannot tell a constant pressure from constant counts.
    assert {constant["effect"], *constant["alternatives"]} >= {"preload"} or constant["effect"] == "baseline"
    assert constant["recordings"] == ["walk"]
    force = found["heldout"]["f_z"]
    assert force["after"] < 0.15 * force["before"]  # 0.4 where the walk has to tell the loop itself
