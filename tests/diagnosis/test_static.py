"""What recalibration removes, told from the curves alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from insole_daemon.diagnosis.static import changes, compare
from insole_daemon.physics import calibration as calibrations
from insole_daemon.physics.curve_inverse import CurveInverse

from . import chamber


def words(tmp_path: Path, stretch: float, creeps: bool) -> list[str]:
    """What is said of curves that are the believed ones at `stretch` times the load."""
    known = calibrations.load(chamber.write(tmp_path, seconds=10.0) / "calibration.json", chamber.LAYOUT)
    bent = np.tile([0.0, 6e3, 0.0, 0.0, 0.0, 0.0, 0.0, 6e-7], (*known.usable.shape, 1))  # a knee at some 200 kPa
    calibration = replace(known, coefficients_pa=bent)
    loads = np.linspace(0.0, 300e3, 60)
    far = np.repeat(stretch * loads[:, None], len(chamber.SLOTS), axis=1)
    fitted = CurveInverse(bent.reshape(-1, 8)[chamber.SLOTS])(far).T
    found = compare(chamber.SLOTS, loads, fitted, calibration, creeps, 0.3)
    return [each.word for each in changes(found, 0.3, chamber.LAYOUT, (3,))]


def test_what_never_comes_of_a_creep_is_no_stiffening(tmp_path: Path) -> None:
    assert "stiffening" in words(tmp_path / "without", 1.3, creeps=False)
    assert "stiffening" not in words(tmp_path / "with", 1.3, creeps=True)
