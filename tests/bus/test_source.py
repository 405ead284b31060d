"""When `collect` looks at a source of frames."""

from __future__ import annotations

import time

import pytest

from insole_daemon.bus.frames import FrameBatch
from insole_daemon.bus.source import BusCounters, collect

_US = 1_000
_LATE = 20_000_000_000


class TimedSource:
    """Frames that arrive at given times of a clock that only sleeping and waiting move; all looks are kept."""

    interfaces = ("can0",)
    counters = BusCounters()
    exhausted = False

    def __init__(self, arrivals_ns: list[int]) -> None:
        self.arrivals_ns = arrivals_ns
        self.now_ns = 0
        self.looks_ns: list[int] = []
        self.waits = self.drained = 0

    def clock_ns(self) -> int:
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9)

    def receive(self) -> int:
        self.looks_ns.append(self.now_ns)
        return sum(arrival_ns <= self.now_ns for arrival_ns in self.arrivals_ns)

    def drain(self) -> FrameBatch:
        self.drained += 1
        return FrameBatch.empty()

    def wait(self, timeout_s: float) -> None:
        self.waits += 1
        self.now_ns = min(arrival_ns for arrival_ns in self.arrivals_ns if arrival_ns > self.now_ns)

    def close(self) -> None:
        pass


@pytest.fixture
def eight_frames(monkeypatch: pytest.MonkeyPatch) -> TimedSource:
    """The last at 900 µs."""
    source = TimedSource([200 * _US + 100 * _US * number for number in range(8)])
    monkeypatch.setattr(time, "sleep", source.sleep)
    return source


def test_promised_frames_are_taken_in_shortly_before_and_handed_over_when_promised(eight_frames: TimedSource) -> None:
    _, looked_ns = collect(eight_frames, 8, _LATE, promised_ns=900 * _US)
    assert eight_frames.looks_ns == [650 * _US, 900 * _US]
    assert looked_ns == 900 * _US
    assert (eight_frames.drained, eight_frames.waits) == (1, 0)


def test_frames_that_are_early_are_handed_over_when_promised(eight_frames: TimedSource) -> None:
    _, looked_ns = collect(eight_frames, 4, _LATE, promised_ns=900 * _US)
    assert looked_ns == 900 * _US, "a cycle of another foot may have brought as many"


def test_the_last_frame_is_waited_for_when_it_comes_later_than_promised(eight_frames: TimedSource) -> None:
    _, looked_ns = collect(eight_frames, 8, _LATE, promised_ns=850 * _US)
    assert eight_frames.looks_ns == [600 * _US, 850 * _US, 900 * _US]
    assert looked_ns == 900 * _US
    assert eight_frames.waits == 1


def test_a_promise_delays_nothing_beyond_what_is_due(eight_frames: TimedSource) -> None:
    _, looked_ns = collect(eight_frames, 8, 400 * _US, promised_ns=900 * _US)
    assert 400 * _US < looked_ns < 410 * _US
