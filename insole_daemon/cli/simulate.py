"""`insole simulate`: boards that are not there, on a bus that is."""

from __future__ import annotations

import sys
import threading
from enum import StrEnum
from typing import Annotated

import typer

from .options import BusName, ConfigFile, Seconds, on_end


class Scenario(StrEnum):
    """What the simulated person does."""

    walk = "walk"
    stand = "stand"


def simulate(
    bus: BusName,
    scenario: Annotated[Scenario, typer.Argument(help="What the person does.")] = Scenario.walk,
    config: ConfigFile = None,
    seconds: Seconds = None,
    seed: Annotated[int, typer.Option(help="Of every random draw: same seed, same frames.")] = 0,
) -> None:
    """Play emulated boards with a person on them on a bus."""
    from .. import config as configs
    from ..bus.opening import open_sink
    from ..service.setup import load_layout
    from ..simulation.emulator import Emulator
    from ..simulation.foot import Stand, Walk

    settings = configs.load(config)
    layouts = [load_layout(insole) for insole in settings.insoles]
    load = Walk(layouts, seed=seed) if scenario is Scenario.walk else Stand(layouts)
    stop = threading.Event()
    on_end(stop.set)
    with open_sink(bus) as sink:
        print(f"insole: {scenario.value} on {bus}", file=sys.stderr, flush=True)
        sent = Emulator(settings, layouts, load, seed=seed).play(sink.send, stop, seconds)
    print(f"insole: {sent} frames sent", file=sys.stderr)
