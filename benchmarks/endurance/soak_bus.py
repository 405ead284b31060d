"""A bus whose time is injected: hours of it pass in minutes, and every frame that was on it is known by its kind.

`Clock` takes the place of the module `time` in the live path: it moves on when somebody sleeps or waits, and frames
that fall due meanwhile are in the socket's queue afterwards. The system call that takes them out is the only part of
the path that is replaced; the queue holds as many as the kernel's would and drops what is too much, as it does.
"""

from __future__ import annotations

import socket
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from insole_daemon.bus import link
from insole_daemon.bus.batched_socket import RECEIVE_BUFFER_BYTES, BatchedSocket
from insole_daemon.bus.recovering import RecoveringSource
from insole_daemon.bus.socketcan import SocketCanSource
from insole_daemon.bus.source import BusCounters
from insole_daemon.config import Bus
from insole_daemon.errors import BusError
from insole_daemon.service.daemon import Daemon

# As `skin.streams.Refused` names them; what a frame is, is known from how it was made, not from its bytes.
KINDS = (
    "used", "other", "remote", "extended", "error", "bad_dlc", "unknown_tag", "unconfigured_triangle",
    "unconfigured_board", "overflow",
)  # fmt: skip
INTERFACE = "can0"
_QUEUE_FRAMES = 2 * RECEIVE_BUFFER_BYTES // 768  # the kernel doubles the buffer, and charges 768 bytes a small frame
_STAMP_HEADER = socket.SOL_SOCKET | 35 << 32  # SCM_TIMESTAMPNS
_BOTH_HEADERS = 64  # bytes of control messages with the count of drops


@dataclass(frozen=True, slots=True)
class Frames:
    """n frames on their way to the bus."""

    rows: NDArray[np.uint8]  # (n, 16) struct can_frame
    due_ns: NDArray[np.int64]  # (n,) injected monotonic time, never decreasing
    kind: NDArray[np.uint8]  # (n,) index into KINDS

    def __getitem__(self, rows: slice | NDArray[np.bool_] | NDArray[np.intp]) -> Frames:
        return Frames(self.rows[rows], self.due_ns[rows], self.kind[rows])


class Clock:
    """The module `time` for the live path, at most `speed` times as fast as the real one."""

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self._mono_ns, self.wall_offset_ns = time.monotonic_ns(), time.time_ns() - time.monotonic_ns()
        self._paced_from = self._mono_ns, self._mono_ns  # injected, real
        self._stopped_ns = 0
        self.stops = 0  # that somebody has slept through
        self.passing: Callable[[int], None] = lambda until_ns: None  # told before the time is there

    def monotonic_ns(self) -> int:
        return self._mono_ns

    def time_ns(self) -> int:
        return self._mono_ns + self.wall_offset_ns

    def monotonic(self) -> float:
        return self._mono_ns * 1e-9

    def time(self) -> float:
        return self.time_ns() * 1e-9

    def sleep(self, seconds: float) -> None:
        until_ns = self._mono_ns + max(0, round(seconds * 1e9)) + self._stopped_ns
        self.stops += self._stopped_ns > 0
        self._stopped_ns = 0
        self.passing(until_ns)
        self._mono_ns = until_ns
        injected_ns, real_ns = self._paced_from
        ahead_s = ((until_ns - injected_ns) / self._speed - (time.monotonic_ns() - real_ns)) * 1e-9
        if ahead_s > 5e-4:
            time.sleep(ahead_s)
        elif ahead_s < -0.05:  # what a busy machine took is not caught up with
            self._paced_from = until_ns, time.monotonic_ns()

    def stop_for(self, seconds: float) -> None:
        """The next sleep takes so much longer, as for a process that was stopped."""
        self._stopped_ns = round(seconds * 1e9)

    def inject(self, put: Callable[[object, str, object], None] = setattr) -> None:
        """From now on the live path goes by this clock."""
        for name, module in list(sys.modules.items()):
            if name.startswith("insole_daemon.") and getattr(module, "time", None) is time:
                put(module, "time", self)


class Queue:
    """The receive queue of a socket, and the tally of what went in."""

    def __init__(self) -> None:
        self.put = np.zeros(len(KINDS), np.int64)  # by kind
        self.dropped = 0  # had no room
        self._blocks: deque[tuple[NDArray[np.uint8], NDArray[np.int64], int]] = deque()  # rows, stamps, drops before
        self._n = 0

    def append(self, frames: Frames, wall_offset_ns: int) -> None:
        room = _QUEUE_FRAMES - self._n
        n = min(room, len(frames.rows))
        if n:
            self._blocks.append((frames.rows[:n], frames.due_ns[:n] + wall_offset_ns, self.dropped))
            self._n += n
            self.put += np.bincount(frames.kind[:n], minlength=len(KINDS))
        self.dropped += len(frames.rows) - n

    def take(self, most: int) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.int64], int]]:
        while most and self._blocks:
            rows, stamps, drops = self._blocks.popleft()
            if len(rows) > most:
                self._blocks.appendleft((rows[most:], stamps[most:], drops))
                rows, stamps = rows[:most], stamps[:most]
            most -= len(rows)
            self._n -= len(rows)
            yield rows, stamps, drops


class _FedSocket(BatchedSocket):
    """Takes from a Queue what `recvmmsg` would take from the kernel, into the same memory."""

    def __init__(self, sock: socket.socket, counters: BusCounters, queue: Queue) -> None:
        super().__init__(sock, counters)
        self._queue, self._drops_before = queue, queue.dropped  # a new socket counts from 0

    def receive(self) -> int:
        for rows, stamps, drops in self._queue.take(len(self._frames) - self._held):
            into = slice(self._held, self._held + len(rows))
            self._held += len(rows)
            self._frames[into] = rows
            control = self._control[into]
            control[:, 1] = _STAMP_HEADER
            control[:, 2], control[:, 3] = np.divmod(stamps, 1_000_000_000)
            if drops > self._drops_before:
                control.view(np.uint32)[:, 12] = drops - self._drops_before
                self._headers[into, 5] = _BOTH_HEADERS
        return self._held


class _FedSource(SocketCanSource):
    """The source of one opened bus; `down` is raised once where the bus is lost."""

    def __init__(self, queue: Queue) -> None:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)  # holds a descriptor, as a bus does
        super().__init__(sock, INTERFACE)
        self._batched = _FedSocket(sock, self.counters, queue)
        self.down = False

    def receive(self) -> int:
        if self.down:
            self.down = False
            raise BusError(f"{INTERFACE} went down", "down")
        return super().receive()


class SoakBus(RecoveringSource):
    """`RecoveringSource` on injected time; `chunks` makes what is on the bus, a stretch of time after the other."""

    def __init__(self, clock: Clock, chunks: Callable[[int], Frames]) -> None:
        """`chunks(from_ns)`: the frames of the next second, due from `from_ns` on."""
        self.queue, self.unread = Queue(), 0  # frames sent while the interface was down
        self._clock, self._chunks = clock, chunks
        self._next_chunk_ns = clock.monotonic_ns()
        self._chunk: Frames | None = None
        self._at = 0
        self._down_until_ns = 0
        link.open_bus = self._open  # type: ignore[assignment]
        clock.passing = self._pass
        super().__init__([Bus("opened", INTERFACE)])

    def clock_ns(self) -> int:  # type: ignore[override]  # RecoveringSource has the real clock, whatever is injected
        """Return the injected monotonic time, by which the frames are due and stamped."""
        return self._clock.monotonic_ns()

    def go_down(self, seconds: float) -> None:
        """Lose the interface for so long, in injected time."""
        self._down_until_ns = self._clock.monotonic_ns() + round(seconds * 1e9)
        fed = self._links[0].source
        if isinstance(fed, _FedSource):
            fed.down = True

    def wait(self, timeout_s: float) -> None:
        """Until the next frame or the time is over."""
        self._pass(self._clock.monotonic_ns())
        now_ns, chunk = self._clock.monotonic_ns(), self._chunk
        next_ns = (
            int(chunk.due_ns[self._at]) if chunk is not None and self._at < len(chunk.rows) else now_ns + 1_000_000
        )
        self._clock.sleep(min(max(0.0, timeout_s), (next_ns - now_ns) * 1e-9 + 1e-9))

    def _open(self, bus: Bus) -> _FedSource:
        if self._clock.monotonic_ns() < self._down_until_ns:
            raise BusError(f"{bus} is down", "down")
        return _FedSource(self.queue)

    def _pass(self, until_ns: int) -> None:
        """What is due until then is in the queue, or nowhere while the interface is down."""
        link = self._links[0]
        if link.source is None and link._thread is not None and self._clock.monotonic_ns() >= self._down_until_ns:
            link._thread.join()  # it tries at real speed: how much injected time that takes must not depend on the host
        while True:
            if self._chunk is not None:
                end = int(np.searchsorted(self._chunk.due_ns, until_ns, side="right"))
                if end > self._at:
                    if self._links[0].source is not None:
                        self.queue.append(self._chunk[self._at : end], self._clock.wall_offset_ns)
                    else:
                        self.unread += end - self._at
                    self._at = end
                if end < len(self._chunk.rows) or until_ns < self._next_chunk_ns:
                    return
            if until_ns < self._next_chunk_ns:
                return
            self._chunk, self._at = self._chunks(self._next_chunk_ns), 0
            self._next_chunk_ns += 1_000_000_000


def accounts(bus: SoakBus, daemon: Daemon) -> list[tuple[str, int, int]]:
    """(which frames, how many there were, how many the daemon counted), each pair the same if none went astray."""
    counts = {"used": 0}
    for assembler in daemon._skin.assemblers:
        assembler.settle()
        counts["used"] += int(assembler.arrivals.sum())
    for reason, count in asdict(daemon._skin.streams.refused).items():
        counts[reason] = sum(count.values()) if isinstance(count, dict) else count
    put, counters = bus.queue.put, bus.counters
    rows = [(kind, int(n), counts.pop(kind)) for kind, n in zip(KINDS, put, strict=True)]
    rows += [(reason, 0, n) for reason, n in counts.items()]
    rows.append(("dropped by the full queue", bus.queue.dropped, counters.overflows))
    return [*rows, ("all that came in", int(put.sum()), counters.frames)]
