"""`insole replay`: a candump log onto a bus."""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from typing import Annotated

import typer

from .options import BusName, on_end


def replay(
    log: Annotated[Path, typer.Argument(help="candump -l / -L text, also .gz and .zst.")],
    bus: BusName,
    speed: Annotated[float, typer.Option(min=0.001, help="1 keeps the log's timing, 2 is twice as fast.")] = 1.0,
    loop: Annotated[bool, typer.Option(help="Begin again at the end, until stopped.")] = False,
) -> None:
    """Send a candump log on a bus, with the log's timing."""
    from ..bus.replay import play
    from ..bus.sink import open_sink

    stop = threading.Event()
    on_end(stop.set)
    sink = open_sink(bus)
    sent = 0
    try:
        while not stop.is_set():
            sent += play(log, sink, speed, stop)
            if not loop:
                break
    finally:
        sink.close()
    print(f"insole: {sent} frames sent", file=sys.stderr)
