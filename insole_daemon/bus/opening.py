"""Open a bus by its name, to read it or to send on it."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator
from typing import Protocol

from ..config import Bus
from .pythoncan import open_adapter, open_pythoncan
from .sink import FrameSink, PythonCanSink, SocketCanSink
from .socketcan import COMMAND_FILTERS, open_socket, open_socketcan
from .source import FrameSource


class PollableSource(FrameSource, Protocol):
    """One open bus, which can be polled together with others and sent on."""

    def fileno(self) -> int:
        """Return a descriptor that is readable when frames wait."""
        ...

    def sink(self, patience_s: float) -> FrameSink:
        """Return a sink on this bus: many drivers open an adapter only once, and a second receive queue would fill.

        `patience_s`: time for which the interface may accept no frame before that is an error.
        """
        ...


def open_bus(bus: Bus) -> PollableSource:
    """Open one bus; raises BusError with the failure and its remedy."""
    if bus.driver == "socketcan":
        return open_socketcan(bus.channel)
    return open_pythoncan(bus.driver, bus.channel)


def open_as_boards(bus: Bus) -> PollableSource:
    """Open one bus to receive only what boards receive, the commands; raises BusError with the remedy."""
    if bus.driver == "socketcan":
        return open_socketcan(bus.channel, COMMAND_FILTERS)
    return open_pythoncan(bus.driver, bus.channel)


@contextlib.contextmanager
def open_sink(bus: Bus) -> Iterator[FrameSink]:
    """Open `bus` at 1 Mbit/s only to send on it; raises BusError with the failure and its remedy."""
    if bus.driver == "socketcan":
        with open_socket(bus.channel, ignore_rx_error_frames=True) as sock:
            # An empty list of filters lets nothing in: this socket is not read.
            sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"")
            yield SocketCanSink(sock, bus.channel)
    else:
        with open_adapter(bus.driver, bus.channel) as adapter:
            yield PythonCanSink(adapter, str(bus))
