"""Static curves that turn over: readings beyond are read on a straight line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insole_daemon.diagnosis.observations.wrench import turning_count
from insole_daemon.diagnosis.observing import observed
from insole_daemon.recording.loading import load

from .. import chamber


@pytest.mark.parametrize(
    ("coefficients_pa", "from_count"),
    [
        ([0.0, 1000.0], np.inf),
        ([0.0, 1000.0, 10.0], np.inf),
        ([0.0, 1000.0, 0.0, -0.1], 53.0),  # 1000 − 0.3·a² is a quarter of 1000 − 0.1·a² at 52.2
        ([0.0, -100.0, 100.0, 0.0], np.inf),  # falls at first
    ],
)
def test_a_curve_turns_where_it_rises_by_a_quarter_of_its_mean(coefficients_pa, from_count):
    assert turning_count(np.array(coefficients_pa)) == pytest.approx(from_count)


def test_what_a_curve_does_above_its_readings_does_not_hide_that_it_turns():
    coefficients_pa = np.array([0.0, 1000.0, -1000.0 / 98.0, 1000.0 / (3.0 * 98.0**2)])  # slope 1000·(1 − a/98)²
    assert turning_count(coefficients_pa) == np.inf  # steepest at 255
    assert turning_count(coefficients_pa, 98.0) < 98.0


def test_a_curve_whose_range_is_unknown_is_straight_above_the_readings(tmp_path):
    recording = load(chamber.write(tmp_path / "bag", seconds=20.0))
    (seen,) = observed([recording], list(recording.feet), None, lambda text: None, ())
    unknown = replace(seen, calibration=replace(seen.calibration, highest_count=None))
    top = np.broadcast_to(unknown.top_count, (1, *unknown.usable.shape))
    far = unknown.slope_at(top + 1e4)
    assert np.array_equal(far, unknown.slope_at(top))
    assert unknown.static_pa(top + 1e4) == pytest.approx(unknown.static_pa(top) + 1e4 * far)
