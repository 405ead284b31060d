"""The one contract of everything frames come from, and the wait that is fair to a CPU."""

from __future__ import annotations

import ctypes
import time
from dataclasses import dataclass, field
from typing import Literal, Protocol

from .frames import FRAME_TIME_NS, FrameBatch

# With this few frames outstanding a sleep saves nothing over being woken by the frame itself.
_WOKEN_BELOW = 2
# A process that has slept for milliseconds works three times as slowly at first: the frames that are there when it
# wakes so early cost it the slow part, while the last ones are on the bus.
_EARLY_NS = 250_000


State = Literal["up", "down", "missing", "bus-off"]


@dataclass(slots=True)
class InterfaceState:
    """How one interface is, and how it has been."""

    state: State
    since_ns: int  # CLOCK_REALTIME
    reopened: int = 0  # times it came back
    error: str | None = None  # the last one with its remedy, also when it is over


@dataclass(slots=True)
class BusCounters:
    """What one source has seen and lost since it was opened."""

    frames: int = 0
    overflows: int = 0  # frames the kernel dropped because its receive queue was full (SO_RXQ_OVFL)
    error_frames: dict[str, int] = field(default_factory=dict)  # by kind, as bus.error_frames names them
    clock_steps: int = 0  # times the receive time went backwards
    interfaces: dict[str, InterfaceState] = field(default_factory=dict)  # of a source that recovers them

    def add(self, other: BusCounters) -> None:
        """Count what another source has counted."""
        self.frames += other.frames
        self.overflows += other.overflows
        self.clock_steps += other.clock_steps
        for kind, count in other.error_frames.items():
            self.error_frames[kind] = self.error_frames.get(kind, 0) + count


class FrameSource(Protocol):
    """Frames of one or several interfaces.

    Taking in and handing over are two steps, so that a reader can wait until enough frames are there
    without looking at any of them: `receive` takes in what has arrived and says how many frames are held,
    `drain` hands them over as one batch.
    """

    interfaces: tuple[str, ...]

    @property
    def counters(self) -> BusCounters:
        """What has been seen and lost."""
        ...

    def receive(self) -> int:
        """Take in what has arrived, without blocking; the number of frames now held."""
        ...

    def drain(self) -> FrameBatch:
        """Hand over the frames held, oldest first; the batch is the caller's to keep."""
        ...

    def wait(self, timeout_s: float) -> None:
        """Block until at least one more frame can be received, or the time is over, or a signal came."""
        ...

    def clock_ns(self) -> int:
        """The present on the clock of `t_mono_ns`: the monotonic clock of a bus, a log's own time of a log."""
        ...

    @property
    def exhausted(self) -> bool:
        """Whether no frame can ever come again (the end of a log)."""
        ...

    def close(self) -> None:
        """Release the interface; idempotent."""
        ...


_PR_SET_TIMERSLACK = 29
_SLACK_NS = 1_000


def sleep_precisely() -> None:
    """Have this thread woken when its sleeps are over, and not up to 50 µs later, as the kernel does by default."""
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, _SLACK_NS, 0, 0, 0)


def collect(
    source: FrameSource, at_least: int, until_ns: int, promised_ns: int | None = None
) -> tuple[FrameBatch, int]:
    """Frames of `source`, as soon as `at_least` are there and the promised time has come, or what there is at
    `until_ns`, on the source's clock; and the time up to which every frame that had arrived is among them.

    Waking up costs more than reading, so it is done as seldom as can be. Where they are promised for a moment (boards
    keep their rhythm), the process sleeps until _EARLY_NS before it and takes in what is there, which makes it warm;
    then it sleeps until that moment, when the last ones are there as well. A bus needs FRAME_TIME_NS for a frame: while
    many are outstanding it sleeps for as long as they cannot all have arrived. Only for the last ones does it ask to be
    woken by each frame.
    """
    if promised_ns is not None:
        if _sleep_until(min(promised_ns - _EARLY_NS, until_ns), source):
            source.receive()
        _sleep_until(min(promised_ns, until_ns), source)
    frame_time_ns = FRAME_TIME_NS // max(1, len(source.interfaces))
    while True:
        looked_ns = source.clock_ns()
        held = source.receive()
        left_ns = until_ns - looked_ns
        outstanding = at_least - held
        if outstanding <= 0 or left_ns < 0 or source.exhausted:
            return source.drain(), looked_ns
        if outstanding > _WOKEN_BELOW:
            time.sleep(min(left_ns, (outstanding - 1) * frame_time_ns) * 1e-9 + 1e-6)
        else:
            source.wait(left_ns * 1e-9 + 1e-6)


def _sleep_until(wake_ns: int, source: FrameSource) -> bool:
    """Sleep until `wake_ns` on the source's clock; whether that was still to come."""
    pause_ns = wake_ns - source.clock_ns()
    if pause_ns <= 0:
        return False
    time.sleep(pause_ns * 1e-9)
    return True
