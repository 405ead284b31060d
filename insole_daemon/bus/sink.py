"""The one contract of everything frames go to, and the way there from the name of a bus."""

from __future__ import annotations

import errno
import socket
import time
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..config import Bus
from ..errors import BusError
from .frames import ERROR, EXTENDED, REMOTE, FrameBatch
from .socketcan import cannot_open

_PATIENCE_S = 1.0  # a transmit queue that takes nothing for so long is stuck
_RETRY_S = 0.0005  # some four frames of a 1 Mbit/s bus
_FULL = (errno.ENOBUFS, errno.EAGAIN)  # the interface's queue; the socket's own

_CAN_FRAME = np.dtype(
    [("can_id", "=u4"), ("dlc", "u1"), ("padding", "u1", 3), ("data", "u1", 8)]
)  # struct can_frame, linux/can.h


class FrameSink(Protocol):
    """Takes frames, in order; their times are not looked at."""

    def send(self, batch: FrameBatch) -> None:
        """Hand the frames to the interface, all of them; raises BusError when it does not take them."""
        ...

    def close(self) -> None:
        """Release the interface; idempotent."""
        ...


def can_frames(batch: FrameBatch) -> NDArray[np.uint8]:
    """(n, 16) the frames as `struct can_frame` in the byte order of this machine."""
    frames = np.zeros(len(batch), _CAN_FRAME)
    frames["can_id"] = batch.can_id
    # The flag bits stand at 31, 30 and 29 there; a CAN FD frame has another struct and is not meant here.
    for flag, bit in ((EXTENDED, 31), (REMOTE, 30), (ERROR, 29)):
        frames["can_id"] |= ((batch.flags & flag) != 0).astype(np.uint32) << np.uint32(bit)
    frames["dlc"] = batch.dlc
    frames["data"] = batch.data
    return frames.view(np.uint8).reshape(-1, 16)


class SocketCanSink:
    """Writes to one socket whose datagrams are `struct can_frame`."""

    def __init__(self, sock: socket.socket, channel: str, patience_s: float | None = None) -> None:
        """`sock` is the sink's to close; `channel` names it in errors; `patience_s`: how long a queue may be full."""
        self._socket = sock
        self._channel = channel
        self._patience_s = patience_s

    def send(self, batch: FrameBatch) -> None:
        """See FrameSink; waits while the interface's transmit queue is full."""
        raw = can_frames(batch).tobytes()
        send = self._socket.send
        for at in range(0, len(raw), 16):
            frame = raw[at : at + 16]
            try:
                send(frame, socket.MSG_DONTWAIT)
            except OSError as error:
                self._retry(frame, error)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _retry(self, frame: bytes, error: OSError) -> None:
        patience_s = _PATIENCE_S if self._patience_s is None else self._patience_s
        give_up = time.monotonic() + patience_s
        while error.errno in _FULL and time.monotonic() < give_up:
            time.sleep(_RETRY_S)
            try:
                self._socket.send(frame, socket.MSG_DONTWAIT)
                return
            except OSError as again:
                error = again
        raise _cannot_send(self._channel, error, patience_s) from error


class PythonCanSink:
    """Sends through a python-can bus, message by message."""

    def __init__(self, bus: Any, name: str, patience_s: float = _PATIENCE_S, shared: bool = False) -> None:
        """`bus` (a `can.BusABC`) is the sink's to shut down, unless it is `shared`; `name` stands in errors."""
        self._bus = bus
        self._name = name
        self._patience_s = patience_s
        self._shared = shared

    def send(self, batch: FrameBatch) -> None:
        """See FrameSink."""
        import can

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

    def close(self) -> None:
        """Shut the bus down, if it is the sink's own."""
        if not self._shared:
            self._bus.shutdown()


def open_sink(bus: Bus, patience_s: float | None = None) -> FrameSink:
    """Open `bus` at 1 Mbit/s; raises BusError that says what failed and what to do.

    `patience_s`: how long a SocketCAN interface may take nothing before that is an error; a second if not given.
    """
    if bus.driver == "socketcan":
        return _open_socketcan(bus.channel, patience_s)
    return _open_pythoncan(bus.driver, bus.channel)


def _open_socketcan(channel: str, patience_s: float | None) -> SocketCanSink:
    import can  # 0.1 s to import, so only where a bus is opened

    try:
        bus = can.Bus(interface="socketcan", channel=channel, ignore_rx_error_frames=True)
    except (OSError, can.CanError) as error:
        raise cannot_open(channel, error) from error
    # python-can closes the socket when the Bus object goes; a duplicate of the descriptor is ours to close.
    own: socket.socket = bus.socket.dup()
    bus.shutdown()
    # No filter at all lets nothing in: nobody reads here.
    own.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"")
    return SocketCanSink(own, channel, patience_s)


def _open_pythoncan(driver: str, channel: str) -> PythonCanSink:
    import can

    try:
        bus = can.Bus(interface=driver, channel=channel, bitrate=1_000_000)
    except (OSError, ValueError, ImportError, can.CanError) as error:
        raise BusError(
            f"{driver}:{channel}: cannot be opened: {error}. "
            f"Is {driver!r} an interface that python-can knows, is its driver installed, "
            "the adapter plugged in?"
        ) from error
    return PythonCanSink(bus, f"{driver}:{channel}")


def _cannot_send(channel: str, error: OSError, patience_s: float) -> BusError:
    """What a person can do about an interface that takes no frames."""
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
