"""The column of a gain, under a load that is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.load_estimate import KnownLoad
from insole_daemon.diagnosis.observing import observed
from insole_daemon.diagnosis.terms.gain import TERM

from ..chamber import write

MORE = -0.02


def test_the_column_of_a_small_gain_contains_no_noise_of_the_readings(tmp_path):
    """The nuisance of a gain is nearly the same column: noise in one of them is what distinguishes the two."""
    recording = insole_daemon.load(write(tmp_path / "bag", seconds=30.0))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    noise = np.random.default_rng(1).normal(0.0, 1.0, seen.activation_count.shape)
    noisy = replace(seen, activation_count=seen.activation_count + np.where(seen.usable, noise, 0.0))
    assert TERM.column is not None
    column, of_noisy = (TERM.column(KnownLoad(each), {"more": MORE}).by_triangle for each in (seen, noisy))
    linear = TERM.column(KnownLoad(seen), {"more": 0.0}).by_triangle
    size = float(np.sqrt(np.mean(linear**2)))
    assert column == pytest.approx(linear, abs=0.1 * size)
    assert of_noisy == pytest.approx(column, abs=1e-3 * size)
