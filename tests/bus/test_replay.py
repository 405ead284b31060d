"""Replaying a log: the same frames at any speed, due when they were recorded."""

from __future__ import annotations

import math
import re
import threading
from pathlib import Path

import numpy as np
import pytest

from insole_daemon.bus import replay
from insole_daemon.bus.candump import read
from insole_daemon.bus.frames import FrameBatch
from insole_daemon.bus.replay import BATCH_FRAMES, CandumpSource, Played, play
from insole_daemon.bus.source import FrameSource, collect
from insole_daemon.errors import InsoleError, LogError

# Milliseconds, interface, frame: a pause, a step backwards after it, and an error frame.
LINES = (
    (1000, "can0", "453#40F0F0EEF0F1EFF0"),
    (1001, "can1", "453#C0F0EFF0F0F00000"),
    (1011, "can0", "20000044#0004000000000000"),
    (5011, "can0", "454#40F0F0EEF0F1EFF0"),
    (5010, "can0", "454#C0F0EFF0F0F00000"),
    (5020, "can1", "123#R"),
)


class Clock:
    """Stands in for the time module: only sleeping makes time pass."""

    def __init__(self) -> None:
        self.now_ns = 77_000_000_000
        self.sleeps_s: list[float] = []

    def monotonic_ns(self) -> int:
        return self.now_ns

    def sleep(self, duration_s: float) -> None:
        self.sleeps_s.append(duration_s)
        self.now_ns += max(1, math.ceil(duration_s * 1e9))


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(replay, "time", clock)
    return clock


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "can.log"
    path.write_text("".join(f"(000000000{t // 1000}.{t % 1000:03d}000) {name} {frame}\n" for t, name, frame in LINES))
    return path


def assert_same(batch: FrameBatch, expected: FrameBatch) -> None:
    for name in FrameBatch.__slots__:
        assert np.array_equal(getattr(batch, name), getattr(expected, name)), name


def all_frames(source: FrameSource) -> FrameBatch:
    batches = []
    while not source.exhausted:
        source.wait(1.0)
        source.receive()
        batches.append(source.drain())
    return FrameBatch.concatenate(batches)


@pytest.mark.parametrize("speed", [None, 1.0, 0.3, 50.0, 1e6])
def test_the_frames_are_those_of_the_log_at_any_speed(path: Path, clock: Clock, speed: float | None) -> None:
    source = CandumpSource(path, speed)
    assert source.interfaces == ("can0", "can1")
    assert_same(all_frames(source), read(path).frames)
    assert source.counters.frames == 6
    assert source.counters.error_frames == {"controller": 1, "bus_off": 1}
    assert source.counters.clock_steps == 1
    assert source.counters.overflows == 0
    assert source.receive() == 0
    assert len(source.drain()) == 0


@pytest.mark.parametrize("speed", [1.0, 2.0, 0.5])
def test_frames_are_due_at_the_spacing_of_the_log(path: Path, clock: Clock, speed: float) -> None:
    source = CandumpSource(path, speed)
    clock.now_ns += 10**12  # the replay starts with the first receive, whenever that is
    assert source.receive() == 1
    start_ns = clock.now_ns
    for due_ms, held in ((1, 2), (11, 3), (4011, 5), (4021, 6)):
        clock.now_ns = start_ns + int(due_ms * 1e6 / speed) - 1
        assert source.receive() < held
        assert not source.exhausted
        clock.now_ns += 1
        assert source.receive() == held
    assert source.exhausted
    assert len(source.drain()) == 6


def test_wait_sleeps_until_the_next_frame_is_due(path: Path, clock: Clock) -> None:
    source = CandumpSource(path, 1.0)
    source.wait(1.0)
    assert clock.sleeps_s == []
    source.receive()
    source.wait(1.0)
    source.wait(0.0)
    assert clock.sleeps_s == pytest.approx([0.001, 0.0])
    assert source.receive() == 2
    source.wait(0.004)
    source.wait(1.0)
    assert clock.sleeps_s[2:] == pytest.approx([0.004, 0.006])
    source.receive()
    source.wait(1.0)  # 4 s are left: in between a signal's handler may have asked for an end
    assert clock.sleeps_s[4:] == pytest.approx([0.1])


def test_wait_at_the_end_lets_time_pass(path: Path, clock: Clock) -> None:
    source = CandumpSource(path, None)
    source.wait(0.05)
    assert clock.sleeps_s == []
    source.receive()
    source.wait(0.05)
    assert clock.sleeps_s == [0.05]


def test_at_once_means_in_bounded_batches(tmp_path: Path) -> None:
    path = tmp_path / "can.log"
    path.write_text("".join(f"(0000000001.{i:06d}) can0 123#\n" for i in range(BATCH_FRAMES + 10)))
    source = CandumpSource(path, None)
    assert len(source.drain()) == 0
    assert source.receive() == source.receive() == BATCH_FRAMES
    assert not source.exhausted
    assert len(source.drain()) == BATCH_FRAMES
    assert source.receive() == 10
    assert source.exhausted
    assert len(source.drain()) == 10


def test_collecting_cycles_from_a_log(path: Path) -> None:
    source = CandumpSource(path, None)
    batch, looked_ns = collect(source, 4, until_ns=2**62)
    assert_same(batch, read(path).frames)
    assert looked_ns == 1_000_000_000
    assert source.exhausted
    batch, looked_ns = collect(source, 4, until_ns=2**62)
    assert len(batch) == 0
    assert looked_ns == source.clock_ns() == 5_021_000_000


@pytest.mark.parametrize("speed", [1.0, 0.5, 3.0])
def test_the_clock_is_that_of_the_log(path: Path, clock: Clock, speed: float) -> None:
    source = CandumpSource(path, speed)
    assert source.clock_ns() == 1_000_000_000
    clock.now_ns += 10**10
    assert source.clock_ns() == 1_000_000_000  # not started yet
    source.receive()
    clock.now_ns += 3_000_000_000
    assert source.clock_ns() == 1_000_000_000 + int(3_000_000_000 * speed)


@pytest.mark.parametrize("speed", [None, 1.0, 0.3, 50.0])
def test_every_frame_up_to_the_clock_has_been_received(path: Path, clock: Clock, speed: float | None) -> None:
    source, times_ns = CandumpSource(path, speed), read(path).frames.t_mono_ns
    received = 0
    while not source.exhausted:
        source.wait(1.0)
        looked_ns = source.clock_ns()
        source.receive()
        received += len(source.drain())
        assert (times_ns[received:] > looked_ns).all()


def test_a_step_backwards_between_batches_is_counted(path: Path, clock: Clock) -> None:
    source = CandumpSource(path, 1.0)
    counts = []
    while not source.exhausted:
        source.wait(1.0)
        source.receive()
        source.drain()
        counts.append(source.counters.clock_steps)
    assert counts[-1] == 1


def test_dropped_frames_and_warnings_of_the_log(path: Path) -> None:
    with path.open("a") as file:
        file.write("DROPCOUNT: dropped 7 CAN frames on 'can0' socket (total drops 7)\n(0000")
    source = CandumpSource(path)
    assert source.counters.overflows == 7
    assert any("is torn" in warning for warning in source.warnings)


def test_close_ends_the_replay(path: Path, clock: Clock) -> None:
    for speed in (None, 1.0):
        source = CandumpSource(path, speed)
        source.receive()
        source.close()
        source.close()
        assert source.exhausted
        assert source.receive() == 0
        assert len(source.drain()) == 0
        assert source.clock_ns() > 0
        source.wait(0.0)


@pytest.mark.parametrize("speed", [0.0, -1.0, 1.1e6, math.inf, math.nan])
def test_invalid_replay_speed_is_refused(path: Path, speed: float) -> None:
    with pytest.raises(
        InsoleError,
        match=f"expected a replay speed above 0 and up to 1e.06, .* found {re.escape(format(speed, 'g'))}",
    ):
        CandumpSource(path, speed)


class Sink:
    """Remembers what it is sent, and when."""

    def __init__(self, clock: Clock) -> None:
        self.clock, self.sent = clock, []

    def send(self, batch: FrameBatch) -> None:
        self.sent += [(self.clock.now_ns // 10**6, int(can_id)) for can_id in batch.can_id]

    def close(self) -> None:
        pass


def test_playing_sends_everything_but_error_frames_in_time(path: Path, clock: Clock) -> None:
    sink, start_ms, played = Sink(clock), clock.now_ns // 10**6, Played()
    play(path, sink, 1.0, threading.Event(), played)
    assert played == Played(sent=5, others=1)
    assert [(t_ms - start_ms, can_id) for t_ms, can_id in sink.sent] == [
        (0, 0x453), (1, 0x453), (4011, 0x454), (4011, 0x454), (4021, 0x123)
    ]  # fmt: skip


def test_playing_stops_when_asked(path: Path, clock: Clock) -> None:
    stop = threading.Event()
    stop.set()
    played = Played()
    play(path, Sink(clock), 1.0, stop, played)
    assert played == Played()


def test_playing_commands_no_board(tmp_path: Path, clock: Clock) -> None:
    answers = ["2A0#1C0B0119000200FF", "35E#0105010000", "7A5#", "350#4000000000000000", "650#C000000000000000"]
    commands = ["705#00", "70F#FF", "70F#00", "205#0700", "20F#3206", "7A5#00", "2A6#3206", "200#00", "205#R", "705#R"]
    others = ["00000705#00", "705##000", "20000044#0004000000000000"]
    path = tmp_path / "can.log"
    path.write_text("".join(f"(1.{at:06d}) can0 {frame}\n" for at, frame in enumerate(answers + commands + others)))
    sink, played = Sink(clock), Played()
    play(path, sink, 1.0, threading.Event(), played)
    assert [f"{can_id:X}" for _, can_id in sink.sent] == [frame.split("#")[0] for frame in answers]
    assert played == Played(sent=5, commands=10, others=3)
    assert played.words == (
        "5 frames sent; left out: 10 that may be commands to boards, 3 error, CAN FD or 29-bit frames"
    )


def test_a_file_that_is_no_log(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="expected a candump log"):
        CandumpSource(tmp_path / "none.log")
