"""Fixtures: a small trial to write, and the folder of recordings by other programs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insole_daemon.bus.frames import FrameBatch
from insole_daemon.config import Config
from insole_daemon.physics import calibration as calibrations
from insole_daemon.physics.calibration import Calibration
from insole_daemon.physics.zero import Zero
from insole_daemon.recording.copies import InsoleContents
from insole_daemon.recording.writer import ReferenceContents, write
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.foot import Walk

START_NS = 1_760_000_000_000_000_000
DATA = Path(__file__).parents[1] / "data"  # excerpts: tests/data/README.md
PUBLISHED = Path(__file__).parents[3] / "shared" / "data" / "belli2023"  # the whole files, where they are


@pytest.fixture(scope="session")
def walk() -> FrameBatch:
    """Return three seconds of a walking left foot."""
    left = Config().insoles[0]
    layout = load_layout(left)
    return Emulator(Config(insoles=(left,)), [layout], Walk([layout])).frames(START_NS, 3.0)


@pytest.fixture(scope="session")
def left() -> InsoleContents:
    """Return the left insole, with a calibration that has a covariance, and a zero."""
    insole = Config().insoles[0]
    layout = load_layout(insole)
    usable = calibrations.default(layout, insole.boards).usable
    shape = usable.shape
    random = np.random.default_rng(1)
    coefficients = np.where(usable[..., None], random.uniform(1, 8000, (*shape, 3)), np.nan)
    covariance = np.where(usable[..., None, None], np.eye(3) * [1.0, 100.0, 2.0], np.nan)
    baseline = np.where(usable, random.uniform(235, 242, shape), np.nan)
    calibration = Calibration("left", baseline, coefficients, covariance, usable, {"by": "a test"})
    zero = Zero("left", START_NS, np.round(baseline + 1, 4), np.where(usable, 0.5, np.nan))
    return InsoleContents("left", insole.boards, layout, calibration, zero)


@pytest.fixture
def reference() -> ReferenceContents:
    time_s = START_NS * 1e-9 + np.arange(60) * 0.05
    pressure_pa = np.linspace(0, 1e5, 60)
    pressure_pa[7] = np.nan
    return ReferenceContents("left", "can", {"time_s": time_s, "pressure_pa": pressure_pa, "temperature_c": time_s * 0})


@pytest.fixture
def trial(tmp_path: Path, walk: FrameBatch, left: InsoleContents, reference: ReferenceContents) -> Path:
    """Write a recording with all of these."""
    return write(
        tmp_path / "trial", kind="chamber", can_origin="simulated", insoles=[left],
        frames=[walk[:1000], walk[1000:]], reference=[reference],
    )  # fmt: skip
