"""From the configured buses to one source of frames, and to the gates through which the daemon sends."""

from __future__ import annotations

from collections.abc import Sequence

from ..config import Bus
from ..errors import BusError
from .gate import Gate
from .pythoncan import PythonCanSource, open_pythoncan
from .several import PollableSource, SeveralSources
from .sink import FrameSink, open_sink
from .socketcan import COMMAND_FILTERS, open_socketcan
from .source import FrameSource

# The loop that sends is the loop that publishes: a queue of ten frames that takes none of our few for so long is
# stuck, and waiting on would cost cycles.
_PATIENCE_S = 0.005
_BOARDS_PATIENCE_S = 1.0  # boards have nothing else to do


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


def open_gates(buses: Sequence[Bus], source: FrameSource, configure: bool) -> dict[str, Gate]:
    """The gate of every bus, by its channel; without `configure` none is opened, and the gates are shut."""
    read = {each.interfaces[0]: each for each in (source.sources if isinstance(source, SeveralSources) else (source,))}
    gates: dict[str, Gate] = {}
    try:
        for bus in buses:
            gates[bus.channel] = Gate(_sink(bus, read[bus.channel]) if configure else None, configure)
    except BusError:
        for gate in gates.values():
            gate.close()
        raise
    return gates


def open_as_boards(bus: Bus) -> tuple[FrameSource, FrameSink]:
    """`bus` as boards see it: the commands that come in, and the way out; raises BusError, with neither left open."""
    if bus.driver != "socketcan":
        python_can = open_pythoncan(bus.driver, bus.channel)
        return python_can, python_can.sink(_BOARDS_PATIENCE_S)
    commands = open_socketcan(bus.channel, COMMAND_FILTERS)
    try:
        return commands, open_sink(bus)
    except BusError:
        commands.close()
        raise


def _sink(bus: Bus, source: FrameSource) -> FrameSink:
    if isinstance(source, PythonCanSource):
        return source.sink(_PATIENCE_S)
    return open_sink(bus, _PATIENCE_S)
