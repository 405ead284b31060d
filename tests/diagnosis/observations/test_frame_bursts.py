"""Places of readings in bursts of frames, from the times of the readings."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.diagnosis.observations.frame_bursts import places_in_bursts
from insole_daemon.diagnosis.observations.readings import TriangleReadings

PERIOD_S = 0.02
BOARDS = np.array([5, 5, 5, 6, 6])


def places_ms(after_ms: list[float], drift: float = 0.0) -> list[float]:
    """Places of five triangles read `after_ms` in each period; the clock of board 6 drifts by `drift`."""
    rng = np.random.default_rng(1)
    readings = []
    for board, start_ms in zip(BOARDS, after_ms, strict=True):
        t_s = 1e-3 * start_ms + np.arange(1000) * PERIOD_S * (1.0 + drift * (board == 6)) + rng.normal(0, 2e-5, 1000)
        readings.append(TriangleReadings(t_s, np.zeros((1000, 12)), np.ones((1000, 12), bool), PERIOD_S))
    return (1e3 * places_in_bursts(readings, BOARDS)).tolist()


def test_boards_that_follow_each_other_at_once_are_one_burst():
    assert places_ms([3.0, 3.25, 3.5, 3.75, 4.0]) == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0], abs=0.02)


def test_the_board_that_sends_first_need_not_be_that_with_the_lowest_address():
    assert places_ms([0.5, 0.75, 1.0, 0.0, 0.25]) == pytest.approx([0.5, 0.75, 1.0, 0.0, 0.25], abs=0.02)


def test_boards_apart_have_bursts_of_their_own():
    assert places_ms([0.0, 0.25, 0.5, 6.0, 6.25]) == pytest.approx([0.0, 0.25, 0.5, 0.0, 0.25], abs=0.02)


def test_boards_whose_clocks_drift_have_bursts_of_their_own():
    assert places_ms([0.0, 0.25, 0.5, 0.75, 1.0], drift=1e-4) == pytest.approx([0.0, 0.25, 0.5, 0.0, 0.25], abs=0.02)


def test_a_triangle_without_readings_has_no_place():
    silent = TriangleReadings(np.empty(0), np.empty((0, 12)), np.empty((0, 12), bool), np.inf)
    assert places_in_bursts([silent] * 5, BOARDS).tolist() == [0.0] * 5
