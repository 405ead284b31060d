"""Every task of a study on real recordings: report, steps, validation and diagnosis, made once and found again."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
import yaml

from insole_daemon.config import Config
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.conditions import ChamberCycles, Conditions
from insole_daemon.simulation.effects_file import load as load_effects
from insole_daemon.simulation.trial import Trial

INSOLE = Path(sys.executable).with_name("insole")
EFFECTS = """format: insole-effects/1
effects:
  - effect: viscoelasticity
    where: {scope: insole}
    parameters: {a: {value: 0.2, unit: "1"}, tau_s: {value: 0.4, unit: s}}
"""
STUDY = """format: insole-study/1
tasks: [report, steps, validation, diagnosis]
calibrations: [walk/calibration.json]
recordings:
  - {folder: walk, person: p01, session: with physics}
  - {folder: chamber, person: p01, session: chamber}
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A walk of the left foot, on an insole with concealed physics, and a chamber."""
    folder = tmp_path_factory.mktemp("study")
    left = Config().insoles[0]
    config, layouts = Config(insoles=(left,)), [load_layout(left)]
    (folder / "effects.yaml").write_text(EFFECTS)
    effects = load_effects(folder / "effects.yaml", layouts)
    Trial("t4", config, layouts, effects=effects, seed=7).write(folder / "walk", 20.0)
    chamber = Conditions(chamber=ChamberCycles(speeds_pa_s=(30e3,), cycles=3, hold_s=1.0, minor=()))
    Trial("vacuum", config, layouts, conditions=chamber, seed=7).write(folder / "chamber")
    (folder / "study.yaml").write_text(STUDY)
    return folder


def run(folder, environment=None):
    command = [INSOLE, "study", folder, "--workers", "1"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert "Traceback" not in done.stderr
    files = {path: path.stat().st_mtime_ns for path in (folder / "results").rglob("*") if path.is_file()}
    return pd.read_csv(folder / "table.csv").set_index("recording"), files


def test_all_tasks_are_collected_and_only_the_judgement_of_a_changed_calibration_is_made_anew(study):
    table, made = run(study)
    walk, chamber = table.loc["walk"], table.loc["chamber"]
    assert pd.isna(walk.missing)
    assert walk.findings_left == "viscoelasticity"
    assert walk.diagnosis_left == "explained"
    (validated,) = json.loads(walk.validation_left)
    assert 20 < validated["f_z"]["rmse_n"] < 120
    assert walk.left_steady_steps >= 5
    assert pd.isna(chamber.missing)
    assert chamber.left_steady_steps == 0, "nobody walks in a chamber"
    assert json.loads(chamber.validation_left)
    tasks = sorted(f"{path.parent.name} {path.name.partition('-')[0]}" for path in made)
    assert tasks == [
        "chamber diagnosis", "chamber report", "chamber steps", "chamber validation",
        "walk diagnosis", "walk report", "walk steps", "walk validation",
    ]  # fmt: skip

    calibration = study / "other.json"
    calibration.write_text((study / "walk" / "calibration.json").read_text() + " ")
    (study / "study.yaml").write_text(STUDY.replace("walk/calibration.json", "other.json"))
    _, again = run(study)
    assert made.items() <= again.items()
    new = sorted(f"{path.parent.name} {path.name.partition('-')[0]}" for path in again.keys() - made.keys())
    assert new == ["chamber validation", "walk validation"]


def test_a_foot_without_reference_does_not_take_the_judgement_of_the_other_foot_away(tmp_path):
    config = Config()
    layouts = [load_layout(insole) for insole in config.insoles]
    folder = Trial("t4", config, layouts, seed=7).write(tmp_path / "walk", 12.0)
    about = folder / "recording.yaml"
    document = yaml.safe_load(about.read_text())
    document["reference"] = [entry for entry in document["reference"] if entry["foot"] == "left"]
    about.write_text(yaml.safe_dump(document))
    (tmp_path / "study.yaml").write_text(
        "format: insole-study/1\ntasks: [validation, diagnosis]\n"
        "calibrations: [walk/left-calibration.json, walk/right-calibration.json]\n"
        "recordings:\n  - {folder: walk, person: p01, session: one}\n"
    )
    table, _ = run(tmp_path)
    row = table.loc["walk"]
    assert pd.isna(row.missing)
    assert json.loads(row.validation_left)
    assert isinstance(row.diagnosis_left, str)
    assert row.diagnosis_left != "no reference"
    assert row.validation_right == row.diagnosis_right == "no reference"


def test_a_recording_that_cannot_be_diagnosed_says_so_in_the_words_of_the_diagnosis(tmp_path):
    left = Config().insoles[0]
    config, layouts = Config(insoles=(left,)), [load_layout(left)]
    Trial("t1", config, layouts, seed=7).write(tmp_path / "still", 10.0)
    without = Trial("t4", config, layouts, seed=7).write(tmp_path / "without", 10.0) / "recording.yaml"
    lines = without.read_text().splitlines(keepends=True)
    without.write_text("".join(line for line in lines if "calibration:" not in line))
    (tmp_path / "study.yaml").write_text(
        "format: insole-study/1\ntasks: [diagnosis]\nrecordings:\n"
        "  - {folder: still, person: p01, session: one}\n  - {folder: without, person: p01, session: two}\n"
    )
    table, _ = run(tmp_path)
    assert table.missing["still"].startswith("diagnosis: left foot: still: the foot is loaded 1 times, expected")
    assert table.missing["without"] == (
        "diagnosis: the left foot has no calibration: list one under analysed_with in study.yaml"
    )


def test_a_diagnosis_that_was_killed_is_no_result_and_states_the_signal(tmp_path):
    left = Config().insoles[0]
    Trial("t4", Config(insoles=(left,)), [load_layout(left)], seed=7).write(tmp_path / "walk", 10.0)
    (tmp_path / "study.yaml").write_text(
        "format: insole-study/1\ntasks: [diagnosis]\nrecordings:\n  - {folder: walk, person: p01, session: one}\n"
    )
    killing = tmp_path / "code" / "sitecustomize.py"  # runs first in every Python
    killing.parent.mkdir()
    killing.write_text('import os, signal, sys\n"diagnose" in sys.orig_argv and os.kill(os.getpid(), signal.SIGKILL)\n')
    table, _ = run(tmp_path, {**os.environ, "PYTHONPATH": str(killing.parent)})
    assert table.missing["walk"].startswith("diagnosis: left foot: the diagnosis was ended by SIGKILL: ")
