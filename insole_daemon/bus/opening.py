"""From the configured buses to one source of frames."""

from __future__ import annotations

from collections.abc import Sequence

from ..config import Bus
from ..errors import BusError
from .pythoncan import open_pythoncan
from .several import PollableSource, SeveralSources
from .socketcan import open_socketcan
from .source import FrameSource


def open_bus(bus: Bus) -> PollableSource:
    """Open one bus; raises BusError that says what failed and what to do."""
    if bus.driver == "socketcan":
        return open_socketcan(bus.channel)
    return open_pythoncan(bus.driver, bus.channel)


def open_source(buses: Sequence[Bus]) -> FrameSource:
    """Open `buses` and read them as one; raises BusError, with none left open."""
    opened: list[PollableSource] = []
    try:
        for bus in buses:
            opened.append(open_bus(bus))
    except BusError:
        for source in opened:
            source.close()
        raise
    return opened[0] if len(opened) == 1 else SeveralSources(opened)
