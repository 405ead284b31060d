"""One bus that may disappear and return: it is reopened whenever it fails.

A thread closes and opens the bus, which takes some drivers seconds, so that the reader never waits.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..config import Bus
from ..errors import BusError
from .error_frames import KINDS
from .frames import ERROR, FrameBatch
from .opening import PollableSource, open_bus
from .sink import FrameSink
from .socketcan import cannot_open
from .source import BusCounters, InterfaceState, State

# Between attempts: a bus that returns must be read within a second, including opening and start of the streams.
_PAUSE_S = 0.1
_INDEX_CHECK_NS = 250_000_000

_BUS_OFF, _RESTARTED = (next(b for b, k in KINDS.items() if k == kind) for kind in ("bus_off", "restarted"))


@dataclass(frozen=True, slots=True)
class InterfaceChange:
    """A change of an interface to another state."""

    interface: str
    t_ns: int  # CLOCK_REALTIME
    before: State
    state: State
    text: str  # what happened, with the remedy


class Link:
    """One bus. Its state belongs to the reader; the thread only hands over an opened source, or the reason why not."""

    def __init__(self, bus: Bus, wake: Callable[[], object]) -> None:
        self.bus = bus
        self.source: PollableSource | None = None
        self.changes: list[InterfaceChange] = []
        self.condition = InterfaceState("up", time.time_ns())
        self._wake = wake
        self._past = BusCounters()  # of sources that are closed
        self._last_frames: FrameBatch | None = None  # of the source that was lost last, not handed over yet
        self._index: int | None = None
        self._check_ns = 0
        self._opened: PollableSource | None = None  # by the thread, to be taken over
        self._failure: BusError | None = None  # of the thread's last attempt
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        try:
            self._take_over(_open(bus))
        except BusError as error:
            if error.permanent:
                raise
            self._enter(error.state, str(error))
            self._recover(None)

    def count_into(self, total: BusCounters) -> None:
        """Add the counts since the start, of all sources of this bus."""
        total.add(self._past)
        if self.source is not None:
            total.add(self.source.counters)

    def receive(self) -> int:
        """See FrameSource; a bus that fails is closed, and the frames held are kept."""
        source, n_last = self.source, 0 if self._last_frames is None else len(self._last_frames)
        if source is None:
            source = self._taken_over()
            if source is None:
                return n_last
        try:
            self._check_index()
            return n_last + source.receive()
        except BusError as error:
            return self._lose(source, error)

    def drain(self) -> FrameBatch:
        """See FrameSource."""
        batch = FrameBatch.empty() if self.source is None else self.source.drain()
        if self._last_frames is not None:
            batch = FrameBatch.concatenate([self._last_frames, batch])
            self._last_frames = None
        if batch.has_flags or self.condition.state == "bus-off":
            self._follow_bus_off(batch)
        return batch

    def sink(self, patience_s: float) -> FrameSink:
        """Return a sink on the open source; raises BusError if none is open."""
        if self.source is None:
            raise BusError(f"nothing is sent: {self.condition.error}. It is used again as soon as it is there")
        return self.source.sink(patience_s)

    def close(self) -> None:
        """Close the source, and end the thread."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
        for source in (self.source, self._opened):
            if source is not None:
                source.close()
        self.source = self._opened = None

    def _taken_over(self) -> PollableSource | None:
        """Take over the source that the thread has opened; if there is none, update the state by the reason."""
        opened, failure = self._opened, self._failure
        if opened is not None:
            self._opened = None
            self._take_over(opened)
            self.condition.reopened += 1
            self._enter("up", f"{self.bus}: is back and read again")
        elif failure is not None and failure.state != self.condition.state:
            self._enter(failure.state, str(failure))
        return opened

    def _take_over(self, source: PollableSource) -> None:
        self.source = source
        self._index = _index(self.bus)
        self._check_ns = time.monotonic_ns() + _INDEX_CHECK_NS

    def _check_index(self) -> None:
        """Raise BusError if another interface has the name now; the open one was renamed and would stay silent."""
        now_ns = time.monotonic_ns()
        if self._index is not None and now_ns >= self._check_ns:
            self._check_ns = now_ns + _INDEX_CHECK_NS
            index = _index(self.bus)
            if index != self._index:
                raise BusError(
                    f"{self.bus}: the interface of this name is another one now (index {self._index} → {index})",
                    "missing",
                )

    def _lose(self, source: PollableSource, error: BusError) -> int:
        """Let the thread close `source` and open the bus again; return the number of frames that it still held."""
        with contextlib.suppress(BusError):
            source.receive()  # the kernel reports the error first; earlier frames still wait
        before = [] if self._last_frames is None else [self._last_frames]
        self._last_frames = FrameBatch.concatenate([*before, source.drain()])
        self._past.add(source.counters)
        self.source = None
        self._enter(error.state, str(error))
        self._recover(source)
        return len(self._last_frames)

    def _recover(self, broken: PollableSource | None) -> None:
        self._failure = None
        self._thread = threading.Thread(
            target=self._reopen, args=(broken,), name=f"reopen {self.bus.channel}", daemon=True
        )
        self._thread.start()

    def _reopen(self, broken: PollableSource | None) -> None:
        """Close the failed source, then try to open the bus until it succeeds."""
        if broken is not None:
            with contextlib.suppress(Exception):  # a driver may raise anything for an adapter that is gone
                broken.close()
        while not self._ended.wait(_PAUSE_S):
            try:
                self._opened = _open(self.bus)
            except BusError as error:
                self._failure = error
            except Exception as error:  # or for one that is half connected
                self._failure = BusError(f"{self.bus}: cannot be opened: {error}", "missing")
            else:
                self._wake()
                return

    def _enter(self, state: State, text: str) -> None:
        now_ns, condition = time.time_ns(), self.condition
        self.changes.append(InterfaceChange(self.bus.channel, now_ns, condition.state, state, text))
        condition.state, condition.since_ns = state, now_ns
        if state != "up":
            condition.error = text

    def _follow_bus_off(self, batch: FrameBatch) -> None:
        """Follow the state bus-off: an error frame reports it, and any data frame ends it."""
        if self.source is None:
            return  # down or missing, which outranks bus-off
        error = (batch.flags & ERROR) != 0
        off = np.flatnonzero(error & ((batch.can_id & _BUS_OFF) != 0))
        on = np.flatnonzero(~error | ((batch.can_id & _RESTARTED) != 0))
        last_off, last_on = (int(rows[-1]) if len(rows) else -1 for rows in (off, on))
        is_off = self.condition.state == "bus-off"
        if last_off >= 0 and not is_off:
            self._enter(
                "bus-off",
                f"{self.bus}: the controller has left the bus after too many errors: check wiring, termination and "
                f"bit rate. 'ip link set {self.bus.channel} type can restart-ms 100' lets it come back by itself",
            )
            is_off = True
        if is_off and last_on > last_off:
            self._enter("up", f"{self.bus}: the controller is back on the bus")


def _open(bus: Bus) -> PollableSource:
    """Open `bus` and read it once: an interface that is down can be opened, and fails at the first read."""
    if bus.driver == "socketcan":
        _look_for(bus)
    source = open_bus(bus)
    try:
        source.receive()
    except BusError:
        source.close()
        raise
    return source


def _look_for(bus: Bus) -> None:
    """Raise BusError if there is no such interface: python-can would leave a socket open for every attempt."""
    try:
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW):
            socket.if_nametoindex(bus.channel)
    except OSError as error:
        number = error.errno or errno.ENODEV  # if_nametoindex does not always tell
        raise cannot_open(bus.channel, OSError(number, os.strerror(number))) from error


def _index(bus: Bus) -> int | None:
    """Return the index of the interface that has the name now; None if there is none, and for other drivers."""
    if bus.driver != "socketcan":
        return None
    try:
        return socket.if_nametoindex(bus.channel)
    except OSError:
        return None
