"""Walks of both feet on one bus, in shoes that warm: no physics is missing, so nothing may be found.

Seeds are fixed, so the tests have no false failures by chance.
"""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from insole_daemon.cli import app

WALKS = [("t4", 3), ("t5", 3), ("t4", 31), ("t6", 32)]  # boards wait for the bus, or are interrupted by others


@pytest.mark.parametrize(("scenario", "seed"), WALKS)
def test_a_walk_in_a_warming_shoe_on_a_shared_bus_is_no_mismatch(tmp_path, scenario, seed):
    run, walk = CliRunner(), tmp_path / "walk"
    made = run.invoke(app, ["simulate", scenario, "--seed", str(seed), "--seconds", "40", "--out", str(walk)])
    assert made.exit_code == 0, made.output
    for foot in ("left", "right"):
        out = tmp_path / foot
        done = run.invoke(app, ["diagnose", str(walk), "--foot", foot, "--out", str(out)])
        assert done.exit_code == 0, done.output
        said = json.loads((out / "diagnosis.json").read_text())
        assert said["verdict"] == "no mismatch", [each["sentence"] for each in said["findings"]]
