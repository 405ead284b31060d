"""All other interfaces of python-can, through its `recv`."""

from __future__ import annotations

import logging
import os
import select
import threading
import time
from collections import deque
from typing import Any

import numpy as np

from ..errors import BusError
from .error_frames import count_kinds
from .frames import ERROR, EXTENDED, FD, REMOTE, FrameBatch
from .sink import PythonCanSink
from .source import BusCounters

_POLL_S = 0.2  # how long the thread may take to see that it should end
# A driver's stamp is used when it is wall-clock time; some count from power-up, and those are replaced.
_PLAUSIBLE_NS = 1_000_000_000


class PythonCanSource:
    """Frames of one python-can bus; a thread blocks in `recv` and passes messages on through a queue."""

    def __init__(self, bus: Any, interface: str) -> None:
        self.interfaces: tuple[str, ...] = (interface,)
        self.counters = BusCounters()
        self._bus = bus
        self._messages: deque[tuple[int, Any]] = deque()
        self._wake = os.eventfd(0, os.EFD_NONBLOCK)
        self._failed: Exception | None = None
        self._stop = threading.Event()
        self._last_t_ns = 0
        self._last_mono_ns = 0
        self._thread = threading.Thread(target=self._read, name=f"recv {interface}", daemon=True)
        self._thread.start()

    @property
    def exhausted(self) -> bool:
        """A bus has no end."""
        return False

    def fileno(self) -> int:
        """Return a descriptor that is readable when frames wait."""
        return self._wake

    def receive(self) -> int:
        """See FrameSource; raises BusError once the interface has failed and all frames have been returned."""
        if self._failed is not None and not self._messages:
            raise BusError(
                f"{self.interfaces[0]}: reading failed: {self._failed}. Is the adapter still plugged in?", "missing"
            ) from self._failed
        return len(self._messages)

    def drain(self) -> FrameBatch:
        """See FrameSource."""
        try:
            os.eventfd_read(self._wake)
        except BlockingIOError:
            pass
        count = len(self._messages)
        if count == 0:
            return FrameBatch.empty()
        stamped = [self._messages.popleft() for _ in range(count)]
        batch = self._batch(stamped)
        self.counters.frames += count
        if batch.flags.any():
            count_kinds(batch, self.counters.error_frames)
        return batch

    def sink(self, patience_s: float) -> PythonCanSink:
        """Return a sink on this bus: many drivers open an adapter only once, and a second receive queue would fill."""
        return PythonCanSink(self._bus, self.interfaces[0], patience_s)

    def clock_ns(self) -> int:
        """Return the monotonic clock."""
        return time.monotonic_ns()

    def wait(self, timeout_s: float) -> None:
        """See FrameSource."""
        if not self._messages:
            select.select([self._wake], [], [], max(0.0, timeout_s))

    def close(self) -> None:
        """End the thread and shut the bus down."""
        if not self._stop.is_set():
            self._stop.set()
            self._thread.join()
            self._bus.shutdown()
            os.close(self._wake)

    def _read(self) -> None:
        while not self._stop.is_set():
            try:
                message = self._bus.recv(_POLL_S)
            except Exception as error:
                self._failed = error
                os.eventfd_write(self._wake, 1)
                return
            if message is not None:
                first = not self._messages
                self._messages.append((time.time_ns(), message))
                if first:
                    os.eventfd_write(self._wake, 1)

    def _batch(self, stamped: list[tuple[int, Any]]) -> FrameBatch:
        messages = [message for _, message in stamped]
        received_ns = np.array([t for t, _ in stamped], np.int64)
        stamp_ns = np.array([round(message.timestamp * 1e9) for message in messages], np.int64)
        t_ns = np.where(abs(stamp_ns - received_ns) < _PLAUSIBLE_NS, stamp_ns, received_ns)
        now_mono_ns = time.monotonic_ns()
        offset_ns = now_mono_ns - time.time_ns()
        t_mono_ns = np.maximum.accumulate((t_ns + offset_ns).clip(self._last_mono_ns, now_mono_ns))
        self.counters.clock_steps += int((np.diff(t_ns, prepend=self._last_t_ns) < 0).sum())
        self._last_t_ns, self._last_mono_ns = int(t_ns[-1]), int(t_mono_ns[-1])
        return FrameBatch(
            t_ns,
            t_mono_ns,
            np.zeros(len(messages), np.uint8),
            np.array([message.arbitration_id & 0x1FFF_FFFF for message in messages], np.uint32),
            np.array([message.dlc for message in messages], np.uint8),
            np.frombuffer(b"".join([bytes(message.data[:8]).ljust(8, b"\0") for message in messages]), np.uint8)
            .reshape(-1, 8)
            .copy(),
            np.array([_flags(message) for message in messages], np.uint8),
        )


def _flags(message: Any) -> int:
    return (
        EXTENDED * bool(message.is_extended_id or message.arbitration_id > 0x7FF)
        | REMOTE * bool(message.is_remote_frame)
        | ERROR * bool(message.is_error_frame)
        | FD * bool(message.is_fd)
    )


def open_pythoncan(driver: str, channel: str) -> PythonCanSource:
    """Open the bus `channel` of python-can's `driver` at 1 Mbit/s; raises BusError with the failure."""
    return PythonCanSource(open_adapter(driver, channel), channel)


def open_adapter(driver: str, channel: str) -> Any:
    """Open the same as a `can.BusABC`, without a thread that reads it."""
    import can

    # An adapter that cannot be opened warns that it was not shut down, at every try to open it again.
    logging.getLogger("can.bus").setLevel(logging.ERROR)
    try:
        return can.Bus(interface=driver, channel=channel, bitrate=1_000_000)
    except (OSError, ValueError, ImportError, can.CanError) as error:
        # An unknown driver, a library that is not installed, a channel that names nothing.
        permanent = isinstance(error, (ValueError, ImportError, can.CanInterfaceNotImplementedError))
        raise BusError(
            f"{driver}:{channel}: cannot be opened: {error}. "
            f"Is {driver!r} an interface that python-can knows, is its driver installed, the adapter plugged in?",
            "missing",
            permanent,
        ) from error
