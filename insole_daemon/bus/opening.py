"""From the name of a bus to what reads it and sends on it."""

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
    """One open bus: it can be waited for together with others, and sent on."""

    def fileno(self) -> int:
        """A descriptor that is readable when frames wait."""
        ...

    def sink(self, patience_s: float) -> FrameSink:
        """A sink on what is read here: many drivers open an adapter once, and nobody would empty a second.

        `patience_s`: how long the interface may take nothing before that is an error.
        """
        ...


def open_bus(bus: Bus) -> PollableSource:
    """Open one bus; raises BusError that says what failed and what to do."""
    if bus.driver == "socketcan":
        return open_socketcan(bus.channel)
    return open_pythoncan(bus.driver, bus.channel)


def open_as_boards(bus: Bus) -> PollableSource:
    """Open one bus as boards hear it, the commands alone; raises BusError that says what failed and what to do."""
    if bus.driver == "socketcan":
        return open_socketcan(bus.channel, COMMAND_FILTERS)
    return open_pythoncan(bus.driver, bus.channel)


@contextlib.contextmanager
def open_sink(bus: Bus) -> Iterator[FrameSink]:
    """Open `bus` at 1 Mbit/s only to send on it; raises BusError that says what failed and what to do."""
    if bus.driver == "socketcan":
        with open_socket(bus.channel, ignore_rx_error_frames=True) as sock:
            # No filter at all lets nothing in: nobody reads here.
            sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"")
            yield SocketCanSink(sock, bus.channel)
    else:
        with open_adapter(bus.driver, bus.channel) as adapter:
            yield PythonCanSink(adapter, str(bus))
