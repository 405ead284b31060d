"""What a load can show: cycles, steps and holds."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from insole_daemon.diagnosis.candidates import candidates
from insole_daemon.diagnosis.excitation import excitation
from insole_daemon.diagnosis.observed import Load
from insole_daemon.errors import UndecidableError

STEP_S = 0.04


def seen(pressure_pa):
    load = Load(0.0, STEP_S, np.asarray(pressure_pa)[:, None], "own")
    return SimpleNamespace(
        load=load, folder=Path("stairs"), cycle_s=np.array([0.0, len(pressure_pa) * STEP_S]), temperature_c=None
    )


def stairs(levels, hold_s=8.0, ramp_s=3.0):
    """Each of the `levels` (Pa) held, and a ramp to the next."""
    t = np.cumsum([0.0, *[hold_s, ramp_s] * len(levels)])[:-1]
    return np.interp(np.arange(0.0, t[-1], STEP_S), t, np.repeat(levels, 2))


def test_one_staircase_up_and_down_is_enough_and_drift_is_not_asked_for():
    found = excitation([seen(stairs([0, 1e5, 2e5, 3e5, 2e5, 1e5, 0]))])
    assert found.reversals == 1
    assert found.hold_s == pytest.approx(8.0, abs=0.5)
    every = candidates(found)
    assert every["creep"].needs(found) is None
    assert every["hysteresis"].needs(found) is None
    assert "turns 1 times" in every["drift"].needs(found)


def test_a_slow_ramp_is_neither_step_nor_hold():
    slow = np.interp(np.arange(0.0, 600.0, STEP_S), [0, 300, 600], [0.0, 3e5, 0.0])
    with pytest.raises(UndecidableError, match="held 0 times.*one ramp fits any physics"):
        excitation([seen(slow)])
    assert excitation([seen(np.concatenate([slow] * 3))]).hold_s == 0.0


def test_stairs_that_only_rise_decide_nothing():
    with pytest.raises(UndecidableError, match="turns 0 times"):
        excitation([seen(stairs([0, 1e5, 2e5, 3e5, 4e5, 5e5, 6e5]))])
