"""From the configured buses to one source of frames."""

from __future__ import annotations

from collections.abc import Sequence

from ..config import Bus
from ..errors import BusError
from .pythoncan import open_pythoncan
from .several import PollableSource, SeveralSources
from .socketcan import open_socketcan
from .source import FrameSource


def open_source(buses: Sequence[Bus]) -> FrameSource:
    """Open `buses` and read them as one; raises BusError, with none left open."""
    opened: list[PollableSource] = []
    try:
        for bus in buses:
            if bus.driver == "socketcan":
                opened.append(open_socketcan(bus.channel))
            else:
                opened.append(open_pythoncan(bus.driver, bus.channel))
    except BusError:
        for source in opened:
            source.close()
        raise
    return opened[0] if len(opened) == 1 else SeveralSources(opened)
