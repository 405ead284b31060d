"""The interface of frame sources, and a wait for frames that needs little CPU."""

from __future__ import annotations

import ctypes
import time
from dataclasses import dataclass, field
from typing import Literal, Protocol

from .frames import FRAME_TIME_NS, FrameBatch

# With so few frames outstanding, a sleep saves nothing over being woken by the frame itself.
_WOKEN_BELOW = 2
# A process that has slept for milliseconds is three times as slow at first. Waking this early moves that slow part
# to the frames that have already arrived, while the last ones are still on the bus.
_EARLY_NS = 250_000


State = Literal["up", "down", "missing", "bus-off"]


@dataclass(slots=True)
class InterfaceState:
    """The state of one interface, and its history."""

    state: State
    since_ns: int  # CLOCK_REALTIME
    reopened: int = 0  # times it came back
    error: str | None = None  # the last one with its remedy, also when it is over


@dataclass(slots=True)
class BusCounters:
    """Counters of one source since it was opened."""

    frames: int = 0
    overflows: int = 0  # frames the kernel dropped because its receive queue was full (SO_RXQ_OVFL)
    error_frames: dict[str, int] = field(default_factory=dict)  # by kind, as bus.error_frames names them
    clock_steps: int = 0  # times the receive time went backwards
    interfaces: dict[str, InterfaceState] = field(default_factory=dict)  # of a source that recovers them

    def add(self, other: BusCounters) -> None:
        """Add the counts of another source."""
        self.frames += other.frames
        self.overflows += other.overflows
        self.clock_steps += other.clock_steps
        for kind, count in other.error_frames.items():
            self.error_frames[kind] = self.error_frames.get(kind, 0) + count


class FrameSource(Protocol):
    """Frames of one or several interfaces.

    Receiving and returning frames are two steps, so that a reader can wait for enough frames without decoding any:
    `receive` takes in the frames that have arrived and returns how many are held, `drain` returns them as one batch.
    """

    interfaces: tuple[str, ...]

    @property
    def counters(self) -> BusCounters:
        """The counters since the start."""
        ...

    def receive(self) -> int:
        """Receive the frames that have arrived, without blocking; return the number of frames now held."""
        ...

    def drain(self) -> FrameBatch:
        """Return the frames held, oldest first; the caller may keep the batch."""
        ...

    def wait(self, timeout_s: float) -> None:
        """Block until another frame can be received, the time is over, or a signal arrives."""
        ...

    def clock_ns(self) -> int:
        """Return the current time on the clock of `t_mono_ns`: the monotonic clock, or a log's own time."""
        ...

    @property
    def exhausted(self) -> bool:
        """Whether no further frame can arrive (the end of a log)."""
        ...

    def close(self) -> None:
        """Release the interface; idempotent."""
        ...


_PR_SET_TIMERSLACK = 29
_SLACK_NS = 1_000


def sleep_precisely() -> None:
    """Set the timer slack of this thread to 1 µs; by default sleeps take up to 50 µs longer."""
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, _SLACK_NS, 0, 0, 0)


def collect(
    source: FrameSource, at_least: int, until_ns: int, promised_ns: int | None = None
) -> tuple[FrameBatch, int]:
    """Return frames of `source`, and the time up to which every frame that had arrived is among them.

    Returns as soon as `at_least` frames have arrived and `promised_ns` has come, at the latest at `until_ns`; both are
    on the source's clock.

    Waking up costs more than reading, so the process wakes as rarely as possible. If boards are periodic, it sleeps
    until _EARLY_NS before the promised time, receives the frames that wait, which fills the CPU's caches, and sleeps
    until the promised time, when the last frames have arrived. Without a promised time it sleeps as long as the
    outstanding frames need on the bus (FRAME_TIME_NS each). Only for the last ones is it woken by each frame.
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
    """Sleep until `wake_ns` on the source's clock; return whether that was in the future."""
    pause_ns = wake_ns - source.clock_ns()
    if pause_ns <= 0:
        return False
    time.sleep(pause_ns * 1e-9)
    return True
