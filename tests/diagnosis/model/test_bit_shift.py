"""The column of a bit shift is what the digitiser does, around its own zero."""

from __future__ import annotations

import numpy as np

import insole_daemon
from insole_daemon.diagnosis.load_estimate import KnownLoad
from insole_daemon.diagnosis.observing import observed
from insole_daemon.diagnosis.terms import bit_shift

from ..chamber import write

ZERO_COUNT = 240 + (1 - 2.0**-3) / 2  # of boards with a no-load of 240 and a shift of 3


def halved(t_s, counts):
    """Drop one more bit: what is below no-load is half as large, and so is the offset of the calibration's baseline."""
    counts[:] = ZERO_COUNT - (ZERO_COUNT - counts) / 2.0


def test_a_bit_shift_acts_on_what_is_below_no_load_and_not_on_the_activation(tmp_path):
    recording = insole_daemon.load(write(tmp_path / "bag", touch=halved, seconds=20.0))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    steps = bit_shift.TERM.columns(KnownLoad(seen))
    (one_bit,) = (each.by_triangle for each in steps if each.settings[0]["step"] == 1.0)
    at_rest = seen.t_s < 1.5
    pressure_pa = (seen.wrench + one_bit[..., 0, 0])[at_rest].mean(axis=0)
    np.testing.assert_allclose(pressure_pa, 0.0, atol=1.2e3)  # 0.2 counts; a factor on the activation misses by more
