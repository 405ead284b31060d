"""Fixtures: recordings of a small simulated insole, a chamber trial and tasks on a force shoe, made once."""

from __future__ import annotations

import csv
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from insole_daemon.simulation.conditions import ChamberCycles

sys.path.insert(0, str(Path(__file__).parent))  # the helpers of this folder are modules beside the tests

from small_insole import made


@pytest.fixture(scope="session")
def chamber(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record two cycles to 90 kPa and a hold."""
    cycles = ChamberCycles(speeds_pa_s=(6e3,), cycles=2, hold_s=5.0, minor=())
    return made(tmp_path_factory.mktemp("trials") / "vacuum", "vacuum", chamber=cycles)


@pytest.fixture(scope="session")
def tasks(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Record t1, t2 and t3 with 63 kg, and t4 with 54 kg."""
    folder = tmp_path_factory.mktemp("tasks")
    folders = {name: made(folder / name, name) for name in ("t1", "t2", "t3")}
    return folders | {"t4": made(folder / "t4", "t4", 20.0, mass_kg=54.0)}


Edit = Callable[[Path, Callable[[list[dict[str, str]]], list[dict[str, str]]]], Path]


@pytest.fixture
def edited(tmp_path: Path) -> Edit:
    """Return a function that copies a recording and changes its reference row by row."""

    def edit(folder: Path, change: Callable[[list[dict[str, str]]], list[dict[str, str]]]) -> Path:
        copy = tmp_path / folder.name
        shutil.copytree(folder, copy)
        path = next(copy.glob("*reference.csv"))
        with open(path, newline="") as file:
            rows = change(list(csv.DictReader(file)))
        with open(path, "w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
        return copy

    return edit
