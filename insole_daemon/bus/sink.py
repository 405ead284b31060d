"""Frame sinks: the interface that all have in common, and those of SocketCAN and python-can.

Whoever opened a bus closes it. Every sink checks all frames by `rules` before it sends the first one.
"""

from __future__ import annotations

import errno
import socket
import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import BusError
from .frames import ERROR, EXTENDED, REMOTE, FrameBatch
from .rules import check_may_leave

PATIENCE_S = 1.0  # a transmit queue that takes nothing for this long is stuck
_RETRY_S = 0.0005  # some four frames of a 1 Mbit/s bus
_FULL = (errno.ENOBUFS, errno.EAGAIN)  # the interface's queue; the socket's own

_CAN_FRAME = np.dtype(
    [("can_id", "=u4"), ("dlc", "u1"), ("padding", "u1", 3), ("data", "u1", 8)]
)  # struct can_frame, linux/can.h


class FrameSink(Protocol):
    """Accepts frames in order; their times are ignored."""

    def send(self, batch: FrameBatch) -> None:
        """Send all frames; raises BusError if one may not be sent, or if the interface does not take them."""
        ...


def can_frames(batch: FrameBatch) -> NDArray[np.uint8]:
    """Return the frames as `struct can_frame` in the byte order of this machine, (n, 16)."""
    frames = np.zeros(len(batch), _CAN_FRAME)
    frames["can_id"] = batch.can_id
    # The flags are bits 31, 30 and 29 of the identifier; CAN FD frames have another struct and are not supported.
    for flag, bit in ((EXTENDED, 31), (REMOTE, 30), (ERROR, 29)):
        frames["can_id"] |= ((batch.flags & flag) != 0).astype(np.uint32) << np.uint32(bit)
    frames["dlc"] = batch.dlc
    frames["data"] = batch.data
    return frames.view(np.uint8).reshape(-1, 16)


class SocketCanSink:
    """Writes to one socket whose datagrams are `struct can_frame`."""

    def __init__(
        self,
        sock: socket.socket,
        channel: str,
        patience_s: float = PATIENCE_S,
        refused: Callable[[OSError], None] = lambda _: None,
    ) -> None:
        """`channel`: name in errors; `patience_s`: longest time a queue may be full; `refused` gets a failure."""
        self._socket = sock
        self._channel = channel
        self._patience_s = patience_s
        self._refused = refused

    def send(self, batch: FrameBatch) -> None:
        """See FrameSink; waits while the interface's transmit queue is full."""
        check_may_leave(batch)
        raw = can_frames(batch).tobytes()
        send = self._socket.send
        for at in range(0, len(raw), 16):
            frame = raw[at : at + 16]
            try:
                send(frame, socket.MSG_DONTWAIT)
            except OSError as error:
                self._retry(frame, error)

    def _retry(self, frame: bytes, error: OSError) -> None:
        give_up = time.monotonic() + self._patience_s
        while error.errno in _FULL and time.monotonic() < give_up:
            time.sleep(_RETRY_S)
            try:
                self._socket.send(frame, socket.MSG_DONTWAIT)
                return
            except OSError as again:
                error = again
        self._refused(error)
        raise _cannot_send(self._channel, error, self._patience_s) from error


class PythonCanSink:
    """Sends through a python-can bus, message by message."""

    def __init__(self, bus: Any, name: str, patience_s: float = PATIENCE_S) -> None:
        """`bus` is a `can.BusABC`; `name` and `patience_s` as of a SocketCanSink."""
        self._bus = bus
        self._name = name
        self._patience_s = patience_s

    def send(self, batch: FrameBatch) -> None:
        """See FrameSink."""
        import can

        check_may_leave(batch)
        try:
            for can_id, dlc, flags, data in zip(
                batch.can_id.tolist(),
                batch.dlc.tolist(),
                batch.flags.tolist(),
                batch.data.tolist(),
                strict=True,
            ):
                message = can.Message(
                    arbitration_id=can_id,
                    is_extended_id=bool(flags & EXTENDED),
                    is_remote_frame=bool(flags & REMOTE),
                    is_error_frame=bool(flags & ERROR),
                    dlc=dlc,
                    data=None if flags & REMOTE else data[:dlc],
                )
                self._bus.send(message, timeout=self._patience_s)
        except (OSError, can.CanError) as error:
            raise BusError(
                f"{self._name}: sending failed: {error}. Is the adapter plugged in, "
                "and is another node on the bus that acknowledges?"
            ) from error


def _cannot_send(channel: str, error: OSError, patience_s: float) -> BusError:
    """Return the error, with its remedy, for an interface that takes no frames."""
    if error.errno == errno.ENETDOWN:
        why = f"the interface is down. Bring it up with 'sudo ip link set {channel} up'"
    elif error.errno in (errno.ENODEV, errno.ENXIO):
        why = "the interface is gone. Is the adapter still plugged in?"
    elif error.errno in _FULL:
        why = (
            f"its transmit queue has stayed full for {patience_s:g} s. Is another node on the bus that "
            f"acknowledges, at 1 Mbit/s? 'ip -details link show {channel}' tells its state"
        )
    else:
        why = f"{error}. 'ip -details link show {channel}' tells its state"
    return BusError(f"socketcan:{channel}: sending failed: {why}")
