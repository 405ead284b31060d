"""Loads that are sufficient for a diagnosis: they rise and fall, or are held on steps."""

import numpy as np
import pytest

from insole_daemon.diagnosis.excitation import require_cycles
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
