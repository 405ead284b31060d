"""Damaged recordings: the same seed does the same damage, and a diagnosis of each is an answer or a refusal."""

from __future__ import annotations

import random
import shutil
from pathlib import Path

import pytest

from benchmarks.diagnosis.mutated_recordings import diagnose, mutate, simulate

SEED = 4  # its first four mutations damage each of the four trials once


@pytest.fixture(scope="module")
def trials(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The simulated trials."""
    return simulate(tmp_path_factory.mktemp("trials"))


def test_a_seed_decides_what_is_damaged(tmp_path: Path, trials: list[Path]) -> None:
    every = []
    for name in ("one", "other"):
        folder = tmp_path / name
        shutil.copytree(trials[1], folder)
        changes = mutate(folder, random.Random(SEED), trials)
        every.append((changes, {path.name: path.read_bytes() for path in folder.glob("*/*")}))
    assert every[0] == every[1]
    assert every[0][1] != {path.name: path.read_bytes() for path in trials[1].glob("*/*")}


@pytest.mark.parametrize("number", range(4))
def test_a_damaged_recording_is_answered_or_refused(trials: list[Path], number: int) -> None:
    result = diagnose(number, trials, SEED)
    assert not result.is_defect, (result.changes, result.last_line)
