"""Readings at the top of their range, which are unloaded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import insole_daemon
from insole_daemon.diagnosis.load_estimate import LoadEstimate
from insole_daemon.diagnosis.observing import observed

from ..foot.shoe import write

MOVED_COUNT = 20.0  # by which all readings are higher: without a load beyond the range, with one within it


@pytest.fixture(scope="module")
def moved(tmp_path_factory):
    """Return a walk whose readings are all moved up and clipped at 255."""
    recording = insole_daemon.load(write(tmp_path_factory.mktemp("walk") / "walk"))
    (seen,) = observed([recording], recording.feet, None, lambda text: None, ())
    top = seen.calibration.baseline_count - 255.0
    activation = np.where(seen.usable, np.maximum(seen.activation_count - MOVED_COUNT, top), 0.0)
    return replace(seen, activation_count=activation)


def test_readings_at_the_top_of_their_range_have_no_load_and_no_sensitivity_to_shifts(moved):
    found = moved.with_unloaded()
    at_top = moved.usable & (moved.calibration.baseline_count - moved.activation_count > 254.4)
    assert 0.5 < at_top[:, moved.usable].mean() < 0.95
    assert np.all(found.activation_count[at_top] == 0.0)
    assert np.array_equal(found.activation_count[~at_top], moved.activation_count[~at_top])
    assert np.array_equal(found.cut_off & moved.usable, moved.cut_off & moved.usable)
    load = LoadEstimate(found)
    assert np.all(load.slope_pa[at_top] == 0.0)
    assert np.all(load.slope_pa[~at_top & moved.usable] > 0.0)
    # In the air nothing answers a shift, and on the ground something does.
    force = found.reference.at(found.reference_s)[:, 0]
    answers = np.abs(load.shifted_by_triangle(3.0)[..., 0]).sum(axis=1)
    assert np.median(answers[force < 5.0]) == 0.0
    assert np.median(answers[force > 0.6 * force.max()]) > 0.0


def test_readings_within_their_range_are_unchanged(moved):
    within = replace(moved, activation_count=np.maximum(moved.activation_count, -3.0))
    assert within.with_unloaded() is within
