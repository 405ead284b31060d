"""Replay a recorded log as a source of frames: at the pace of the recording, faster, slower, or at once."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import InsoleError
from .candump import read
from .error_frames import count_kinds
from .frames import ERROR, EXTENDED, FD, FrameBatch
from .rules import never_a_command
from .sink import FrameSink
from .source import BusCounters

BATCH_FRAMES = 4096  # at most in one batch when the log is replayed at once
SPEED_MAX = 1e6

# A sleep continues after a signal whose handler returns, so no sleep is longer than a person waits for a stop.
_SLEEP_MAX_S = 0.1


class CandumpSource:
    """The frames of the candump log at `path`; `speed` 1.0 is the pace of the recording, None is all at once.

    Frames keep the log's times, `t_ns` as recorded and `t_mono_ns` without steps backwards, so results computed from
    them do not depend on the speed. The whole log is read at the start, and takes some 35 bytes of memory per frame.
    """

    def __init__(self, path: str | os.PathLike[str], speed: float | None = 1.0) -> None:
        """Read the log; raises LogError if it is not a log, InsoleError if the speed is not positive."""
        if speed is not None and not 0 < speed <= SPEED_MAX:
            raise InsoleError(
                f"expected a replay speed above 0 and up to {SPEED_MAX:g}, 1 for the pace of the recording, "
                f"found {speed:g}"
            )
        log = read(path)
        self.interfaces = log.interfaces
        self.counters = BusCounters(overflows=log.counters.dropped)
        self.warnings = log.warnings
        self._frames = log.frames
        self._since_first_ns = log.frames.t_mono_ns - log.frames.t_mono_ns[0]
        self._speed = speed
        self._start_mono_ns: int | None = None  # moment of the first receive
        self._handed_over = 0
        self._received = 0

    @property
    def exhausted(self) -> bool:
        """Whether the last frame has been received; it may still be held."""
        return self._received == len(self._frames)

    @property
    def share(self) -> float:
        """Return the share of the log that has been received."""
        return self._received / len(self._frames)

    def receive(self) -> int:
        """Receive the frames that are due; return the number now held. The first call starts the replay."""
        if self._start_mono_ns is None:
            self._start_mono_ns = time.monotonic_ns()
        if self._speed is None:
            self._received = min(self._handed_over + BATCH_FRAMES, len(self._frames))
        elif not self.exhausted:
            passed_ns = self._passed_ns(self._start_mono_ns, self._speed)
            self._received = int(np.searchsorted(self._since_first_ns, passed_ns, side="right"))
        return self._received - self._handed_over

    def drain(self) -> FrameBatch:
        """See FrameSource."""
        first, self._handed_over = self._handed_over, self._received
        if first == self._received:
            return FrameBatch.empty()
        batch = self._frames[first : self._received]
        times_ns = self._frames.t_ns[max(0, first - 1) : self._received]
        self.counters.frames += len(batch)
        self.counters.clock_steps += int(np.count_nonzero(np.diff(times_ns) < 0))
        count_kinds(batch, self.counters.error_frames)
        return batch

    def clock_ns(self) -> int:
        """Return the current time of the log: that of the replay, or of the last frame received if `speed` is None."""
        times_ns = self._frames.t_mono_ns
        if self._speed is None:
            return int(times_ns[max(0, self._received - 1)])
        if self._start_mono_ns is None:
            return int(times_ns[0])
        return int(times_ns[0]) + self._passed_ns(self._start_mono_ns, self._speed)

    def wait(self, timeout_s: float) -> None:
        """Block until the next frame is due or the time is over, but not longer than a person waits for a stop."""
        sleep_s = min(timeout_s, _SLEEP_MAX_S)
        if not self.exhausted:
            if self._speed is None or self._start_mono_ns is None:
                return
            due_ns = self._start_mono_ns + int(self._since_first_ns[self._received]) / self._speed
            sleep_s = min(sleep_s, (due_ns - time.monotonic_ns()) * 1e-9)
        time.sleep(max(0.0, sleep_s))

    def close(self) -> None:
        """End the replay; idempotent."""
        self._handed_over = self._received = len(self._frames)

    @staticmethod
    def _passed_ns(start_mono_ns: int, speed: float) -> int:
        """Return the time of the log that has passed since the replay started."""
        return int((time.monotonic_ns() - start_mono_ns) * speed)


@dataclass(slots=True)
class Played:
    """The number of frames sent, and of those left out by reason."""

    sent: int = 0
    commands: int = 0  # a board might have obeyed them
    others: int = 0  # error frames of the recording driver; CAN FD and 29-bit frames, which boards do not send

    @property
    def words(self) -> str:
        """Return the counts in words."""
        reasons = [
            f"{count} {what}"
            for count, what in (
                (self.commands, "that may be commands to boards"),
                (self.others, "error, CAN FD or 29-bit frames"),
            )
            if count
        ]
        return f"{self.sent} frames sent" + (f"; left out: {', '.join(reasons)}" if reasons else "")


def play(
    path: str | os.PathLike[str],
    sink: FrameSink,
    speed: float,
    stop: threading.Event,
    played: Played,
    progress: Callable[[float], None] = lambda share: None,
) -> None:
    """Send the log to `sink` at its own timing, until `stop`; `played` counts, `progress` gets the share sent, 0 to 1.

    Only frames that no board can take for a command are sent. A log also contains the host's commands, and a real board
    that received them again would take a new baseline or reboot into its bootloader.
    """
    source = CandumpSource(path, speed)
    while not (stop.is_set() or source.exhausted):
        source.wait(_SLEEP_MAX_S)
        source.receive()
        batch = source.drain()
        if len(batch):
            passes, standard = never_a_command(batch), batch.flags & (ERROR | FD | EXTENDED) == 0
            sink.send(batch[passes])
            played.sent += int(np.count_nonzero(passes))
            played.commands += int(np.count_nonzero(standard & ~passes))
            played.others += int(np.count_nonzero(~standard))
            progress(source.share)
