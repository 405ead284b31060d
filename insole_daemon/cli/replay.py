"""`insole replay`: send a candump log on a bus."""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from typing import Annotated

import typer

from .options import BusName, name_next, on_end
from .progress import show_work


def replay(
    log: Annotated[Path, typer.Argument(help="candump -l / -L text, also .gz and .zst.")],
    bus: BusName,
    speed: Annotated[float, typer.Option(min=0.001, help="1 keeps the log's timing, 2 is twice as fast.")] = 1.0,
    loop: Annotated[bool, typer.Option(help="Begin again at the end, until stopped.")] = False,
) -> None:
    """Send the boards' frames of a candump log on a bus, with the log's timing.

    Recorded commands to boards are left out, because real boards would obey them; so are error, CAN FD and 29-bit
    frames. Their number is printed at the end.
    """
    from ..bus.opening import open_sink
    from ..bus.replay import Played, play

    stop = threading.Event()
    on_end(stop.set)
    played = Played()
    with open_sink(bus) as sink, show_work(f"sending {log.name}") as work:
        while not stop.is_set():
            play(log, sink, speed, stop, played, work.done)
            if not loop:
                break
    print(f"insole: {played.words}", file=sys.stderr)
    name_next("insole status, while a daemon reads that bus")
