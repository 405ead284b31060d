"""Static curves that turn over: readings beyond are read on a straight line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insole_daemon.diagnosis.observations.static_curves import StaticCurves, turning_count
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
    assert turning_count(np.array(coefficients_pa), 255.0) == pytest.approx(from_count)


def test_what_a_curve_does_above_its_readings_does_not_hide_that_it_turns():
    coefficients_pa = np.array([0.0, 1000.0, -1000.0 / 98.0, 1000.0 / (3.0 * 98.0**2)])  # slope 1000·(1 − a/98)²
    assert turning_count(coefficients_pa, 255.0) == np.inf  # steepest at 255
    assert turning_count(coefficients_pa, 98.0) < 98.0


def test_a_curve_whose_range_is_unknown_is_straight_above_the_readings(tmp_path):
    recording = load(chamber.write(tmp_path / "bag", seconds=20.0))
    (seen,) = observed([recording], list(recording.feet), None, lambda text: None, ())
    unknown = replace(seen, calibration=replace(seen.calibration, highest_count=None))
    top = np.broadcast_to(unknown.top_count, (1, *unknown.usable.shape))
    far = unknown.slope_at(top + 1e4)
    assert np.array_equal(far, unknown.slope_at(top))
    assert unknown.static_pa(top + 1e4) == pytest.approx(unknown.static_pa(top) + 1e4 * far)


@pytest.mark.parametrize(
    "coefficients_pa",
    [
        [0.0, 9000.0, -664.0, 113.5, -4.19],  # falls from 14 on
        [0.0, 15000.0, -515.0, 3.94],  # falls from 18 on, rises again from 69 on
    ],
)
def test_a_curve_that_falls_before_the_readings_end_goes_on_with_its_mean_slope(coefficients_pa):
    coefficients = np.array(coefficients_pa)
    top = turning_count(coefficients, 60.0)
    curve = StaticCurves(coefficients, top)
    at_top, above = curve.pressure_pa(np.array([float(top), 55.0]))
    assert 10.0 < top < 20.0
    assert above - at_top == pytest.approx(at_top / top * (55.0 - top))
    assert curve.slope_pa(np.array([55.0])) == pytest.approx(at_top / top)


def test_a_curve_that_rises_slowly_at_the_end_of_its_range_goes_on_with_that_slope():
    curve = StaticCurves(np.array([0.0, 10000.0, -60.0]), np.array(60.0))  # 2800 at the top, 6400 on average
    at_top, above = curve.pressure_pa(np.array([60.0, 70.0]))
    assert above - at_top == pytest.approx(28000.0)
