"""The parts that are taken out are those of the pipeline, and what is left still answers."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.diagnosis.ablations import ABLATIONS
from tests.diagnosis.chamber import relaxing, write

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("ablated") / "solid", relaxing(0.3, 0.8), clock="own", seconds=30.0)


@pytest.mark.parametrize("name", ABLATIONS)
def test_it_answers_without(folder, tmp_path, name):
    command = [sys.executable, "-m", "benchmarks.diagnosis.ablations", "--as", name, str(folder), "--out"]
    done = subprocess.run([*command, str(tmp_path / "out")], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (tmp_path / "out" / "diagnosis.json").exists(), done.stderr
    document = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert "viscoelasticity" in [finding["effect"] for finding in document["findings"]]
