"""A course that several series share, where each is known in parts only."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.diagnosis.observations.common_course import common_course

STD = 0.1


def series(course: np.ndarray, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Return series (m, 12) with sensitivities from 0.5 to 2, cut off above 254, and where they are below."""
    rng = np.random.default_rng(seed)
    sensitivity, offset = np.linspace(0.5, 2.0, 12), rng.uniform(251.0, 257.0, 12)
    values = offset + sensitivity * course[:, None] + rng.normal(0.0, STD, (len(course), 12))
    return np.minimum(values, 254.0), values < 254.0


def test_the_course_is_found_though_each_series_is_cut_off_and_some_step_at_once():
    course = 3.0 * np.sin(np.arange(60) / 10.0)
    values, known = series(course)
    segment = np.zeros(values.shape, int)
    segment[25:, 1:] = 1
    values[25:, 1:] -= 6.0  # a board re-zeroed itself, so its pads jump
    assert 0.3 < known.mean() < 0.9
    shared = common_course(values, known, segment, STD)
    assert shared is not None
    assert np.corrcoef(shared.course, course)[0, 1] > 0.99
    assert np.ptp(shared.course) == pytest.approx(np.ptp(course) * 1.25, rel=0.15)  # in units of the median series
    assert shared.agreement > 0.98
    without = common_course(values, known, np.zeros_like(segment), STD)
    assert without is not None
    unexplained = [1.0 - np.corrcoef(each.course, course)[0, 1] ** 2 for each in (shared, without)]
    assert unexplained[0] < 0.3 * unexplained[1]


def test_series_that_share_nothing_do_not_agree():
    values = np.random.default_rng(3).normal(0.0, 1.0, (60, 12))
    shared = common_course(values, np.full(values.shape, True), np.zeros(values.shape, int), STD)
    assert shared is not None
    assert shared.agreement < 0.7


def test_no_course_is_made_up_where_most_of_it_is_out_of_range():
    values, known = series(3.0 * np.sin(np.arange(60) / 10.0))
    known[20:] = False
    assert common_course(values, known, np.zeros(values.shape, int), STD) is None
