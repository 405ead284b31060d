"""An uncalibrated board on a walk: its load is estimated from its readings and the others' curves."""

from __future__ import annotations

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.observations.uncalibrated import with_uncalibrated
from insole_daemon.diagnosis.observations.walk import observe_walk
from insole_daemon.diagnosis.observations.wrench import WrenchObservation

from ..chamber import LAYOUT, Array
from ..foot import shoe
from ..variations import MASKED, varied, without_a_board

OWN = LAYOUT.identities[:, 0] == MASKED


def observed(tmp_path, touch=lambda t_s, read: None, stands_s: float = 0.0) -> WrenchObservation:
    walk = shoe.write(tmp_path / "walk", touch=touch, stands_s=stands_s)
    recording = insole_daemon.load(varied(walk, tmp_path / "masked", without_a_board))
    foot = recording.feet[0]
    return observe_walk(recording, foot, foot.calibration)


def test_the_load_of_an_uncalibrated_board_is_in_the_wrench(tmp_path):
    without = observed(tmp_path)
    found = with_uncalibrated(without)
    assert found.is_estimated.tolist() == OWN.tolist()
    assert np.sqrt(without.mean_square_error[0]) > 20.0
    assert np.sqrt(found.mean_square_error[0]) < 2.5
    assert not found.calibration.usable[OWN].any()


def test_more_sensitive_uncalibrated_boards_are_scaled_to_the_reference(tmp_path):
    def stronger(t_s: Array, read: Array) -> None:
        own = np.repeat(OWN, 12)
        read[:, own] = 240.0 - 1.4 * (240.0 - read[:, own])

    found = with_uncalibrated(observed(tmp_path, stronger))
    others = found.coefficients[1][~OWN][found.usable[~OWN]].mean()
    assert found.coefficients[1][OWN].max() == pytest.approx(others / 1.4, rel=0.05)


def test_a_dead_uncalibrated_board_is_not_estimated(tmp_path):
    def die(t_s: Array, read: Array) -> None:
        read[:, np.repeat(OWN, 12)] = 240.0

    seen = observed(tmp_path, die)
    assert with_uncalibrated(seen) is seen


def test_an_observation_with_complete_calibration_is_unchanged(tmp_path):
    recording = insole_daemon.load(shoe.write(tmp_path / "walk"))
    foot = recording.feet[0]
    seen = observe_walk(recording, foot, foot.calibration)
    assert with_uncalibrated(seen) is seen
