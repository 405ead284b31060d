"""What operations on the loop measure their waits by."""

from __future__ import annotations

import pytest

from insole_daemon.service.operations import AttendedClock, Step, pause

MS = 1_000_000


def test_a_loop_that_comes_by_often_attends_all_the_time() -> None:
    clock = AttendedClock()
    assert [clock.turn(now * MS) for now in (7, 12, 112, 113)] == [7 * MS, 12 * MS, 112 * MS, 113 * MS]


def test_of_a_stop_a_tenth_of_a_second_counts() -> None:
    clock = AttendedClock()
    turns = [clock.turn(now * MS) for now in (0, 5, 2005, 2010, 3010)]
    assert turns == [0, 5 * MS, 105 * MS, 110 * MS, 210 * MS]


def test_a_pause_lasts_through_a_stop_of_the_host() -> None:
    clock = AttendedClock()

    def step(now_ms: int) -> Step:
        return Step(now_ms * MS, [], None, clock.turn(now_ms * MS))  # type: ignore[arg-type]

    paused = pause(step(0), 300 * MS)
    next(paused)
    for now_ms in (100, 5000, 5099):
        paused.send(step(now_ms))
    with pytest.raises(StopIteration) as done:
        paused.send(step(5100))
    assert done.value.value.now_mono_ns == 5100 * MS
