"""SocketCAN: opened through python-can, read in batches by `batched_socket`.

python-can reads one frame per system call and loses the kernel's count of dropped frames (its `capture_message` asks
for one control message only), so it is used only to open the socket.
"""

from __future__ import annotations

import errno
import select
import socket
import time
from typing import Any

from ..errors import BusError
from .batched_socket import BatchedSocket
from .error_frames import count_kinds
from .frames import FrameBatch
from .sink import SocketCanSink
from .source import BusCounters

# Classes of identifiers the daemon reads (bits 10..8): replies to commands, legacy skin stream and thermometer,
# skin stream, the second halves of one special build, and an MTB3's empty overflow frame (0x700 | address << 4 | 5).
FILTERS: list[dict[str, Any]] = [
    {"can_id": 0x200, "can_mask": 0x700, "extended": False},
    {"can_id": 0x300, "can_mask": 0x700, "extended": False},
    {"can_id": 0x400, "can_mask": 0x700, "extended": False},
    {"can_id": 0x600, "can_mask": 0x700, "extended": False},
    {"can_id": 0x700, "can_mask": 0x700, "extended": False},
]
# Identifiers that boards receive.
COMMAND_FILTERS = [FILTERS[0], FILTERS[-1]]

_LONGEST_NAME = 15  # IFNAMSIZ − 1


class SocketCanSource:
    """Frames of one socket whose datagrams are `struct can_frame`."""

    def __init__(self, sock: socket.socket, interface: str) -> None:
        self.interfaces: tuple[str, ...] = (interface,)
        self.counters = BusCounters()
        self._batched = BatchedSocket(sock, self.counters)
        self._socket = sock
        self._lost: OSError | None = None  # reported to a sender

    @property
    def exhausted(self) -> bool:
        """A bus has no end."""
        return False

    def fileno(self) -> int:
        """Return the socket's descriptor, which is readable when frames wait."""
        return self._socket.fileno()

    def receive(self) -> int:
        """See FrameSource; raises BusError if the interface is lost; call it again for the frames before the loss."""
        try:
            if self._lost is not None:
                lost, self._lost = self._lost, None
                raise lost
            return self._batched.receive()
        except OSError as error:
            raise lost_interface(self.interfaces[0], error) from error

    def drain(self) -> FrameBatch:
        """See FrameSource; error frames are counted by kind."""
        batch = self._batched.drain()
        if batch.has_flags:
            count_kinds(batch, self.counters.error_frames)
        return batch

    def sink(self, patience_s: float) -> SocketCanSink:
        """Return a sink on this socket; a raw CAN socket does not receive its own frames."""
        return SocketCanSink(self._socket, self.interfaces[0], patience_s, self._sending_failed)

    clock_ns = staticmethod(time.monotonic_ns)

    def wait(self, timeout_s: float) -> None:
        """See FrameSource."""
        select.select([self._socket], [], [], max(0.0, timeout_s))

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _sending_failed(self, error: OSError) -> None:
        """Keep an error of sending for the reader: the kernel reports a lost interface only once per socket."""
        if error.errno in (errno.ENETDOWN, errno.ENODEV, errno.ENXIO):
            self._lost = error


def open_socketcan(channel: str, filters: list[dict[str, Any]] = FILTERS) -> SocketCanSource:
    """Open the interface `channel` (can0, vcan0 …); raises BusError with the remedy."""
    sock = open_socket(channel, can_filters=filters)
    sock.setblocking(False)
    return SocketCanSource(sock, channel)


def open_socket(channel: str, **options: Any) -> socket.socket:
    """Open a raw CAN socket bound to `channel` with python-can's `options`; raises BusError with the remedy."""
    import can  # 0.1 s to import, so only where a bus is opened

    try:
        bus = can.Bus(interface="socketcan", channel=channel, **options)
    except (OSError, can.CanError) as error:
        raise cannot_open(channel, error) from error
    # python-can closes its socket with the Bus object, so a duplicate of the descriptor is used.
    duplicate: socket.socket = bus.socket.dup()
    bus.shutdown()
    return duplicate


def cannot_open(channel: str, error: Exception) -> BusError:
    """Return the error, with its remedy, for an interface that cannot be opened."""
    number = getattr(error, "errno", None)
    gone = number in (errno.ENODEV, errno.ENXIO)
    permanent = number in (errno.EAFNOSUPPORT, errno.EPERM, errno.EACCES) or len(channel) > _LONGEST_NAME
    if number == errno.EAFNOSUPPORT:
        why = (
            "this kernel has no CAN. Load it with 'sudo modprobe can-raw', or use a kernel built with CONFIG_CAN; "
            "'insole demo' needs none"
        )
    elif len(channel) > _LONGEST_NAME:
        why = f"the name of an interface has at most {_LONGEST_NAME} characters, this has {len(channel)}"
    elif gone:
        why = (
            "there is no such interface. 'ip -brief link show type can' lists those there are; bring it up with "
            f"'sudo ip link set {channel} up type can bitrate 1000000'"
        )
    elif number in (errno.EPERM, errno.EACCES):
        why = (
            "the process may not open a raw CAN socket. In a container or a sandboxed unit allow the address family "
            "AF_CAN (systemd: RestrictAddressFamilies=AF_CAN …)"
        )
    else:
        why = f"{error}. 'ip -details link show {channel}' tells its state"
    return BusError(f"socketcan:{channel}: cannot be opened: {why}", "missing" if gone else "down", permanent)


def lost_interface(channel: str, error: OSError) -> BusError:
    """Return the error, with its remedy, for an interface that failed while it was read."""
    gone = error.errno in (errno.ENODEV, errno.ENXIO)
    if error.errno == errno.ENETDOWN:
        why = f"the interface went down. Bring it up with 'sudo ip link set {channel} up'"
    elif gone:
        why = "the interface is gone. Is the adapter still plugged in?"
    else:
        why = f"{error}"
    return BusError(f"socketcan:{channel}: reading failed: {why}", "missing" if gone else "down")
