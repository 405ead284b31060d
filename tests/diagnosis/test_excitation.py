"""Loads that are sufficient for a diagnosis: they rise and fall, or are held on steps."""

import numpy as np
import pytest

from insole_daemon.diagnosis.excitation import has_one_speed, require_cycles
from insole_daemon.errors import UndecidableError

STEP_S = 0.04


def require(*loads_pa):
    loads = [np.asarray(each) for each in loads_pa]
    require_cycles("stairs", loads, [STEP_S] * len(loads), max(float(np.ptp(each)) for each in loads))


def stairs(levels, hold_s=8.0, ramp_s=3.0):
    """Each of the `levels` (Pa) held, and a ramp to the next."""
    t = np.cumsum([0.0, *[hold_s, ramp_s] * len(levels)])[:-1]
    return np.interp(np.arange(0.0, t[-1], STEP_S), t, np.repeat(levels, 2))


def test_one_staircase_up_and_down_is_enough():
    require(stairs([0, 1e5, 2e5, 3e5, 2e5, 1e5, 0]))


def test_a_slow_ramp_is_neither_step_nor_hold():
    slow = np.interp(np.arange(0.0, 600.0, STEP_S), [0, 300, 600], [0.0, 3e5, 0.0])
    with pytest.raises(UndecidableError, match="held 0 times.*one ramp fits any physics"):
        require(slow)
    require(np.concatenate([slow] * 3))


def test_stairs_that_only_rise_are_undecidable():
    with pytest.raises(UndecidableError, match="turns 0 times"):
        require(stairs([0, 1e5, 2e5, 3e5, 4e5, 5e5, 6e5]))


def test_cycles_of_one_speed_or_one_frequency_have_one_speed():
    t_s = np.arange(0.0, 60.0, STEP_S)
    tops_pa = np.resize([3e5, 2e5, 3e5, 1e5], 30)
    corners_pa = np.stack([np.zeros(30), tops_pa], axis=1).ravel()
    corners_s = np.cumsum([0.0, *np.abs(np.diff(corners_pa)) / 1e5])
    assert has_one_speed(np.interp(t_s, corners_s, corners_pa), STEP_S)
    assert has_one_speed(1e5 * (1.0 - np.cos(2.0 * np.pi * t_s / 4.0)), STEP_S)


def test_another_speed_or_a_hold_is_more_than_one_speed():
    fast = np.abs((np.arange(0.0, 40.0, STEP_S) / 2.0) % 2.0 - 1.0) * 3e5
    slow = np.abs((np.arange(0.0, 40.0, STEP_S) / 8.0) % 2.0 - 1.0) * 3e5
    assert has_one_speed(fast, STEP_S)
    assert not has_one_speed(np.concatenate([fast, slow]), STEP_S)
    assert not has_one_speed(np.concatenate([fast, np.full(round(10.0 / STEP_S), fast[-1]), fast]), STEP_S)
