"""`insole simulate`: emulated boards on a bus, or a simulated trial as a recording."""

from __future__ import annotations

import sys
import threading
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import ConfigFile, Force, OptionalBusName, Seconds, is_repeatable, name_next, on_end, replace_folder
from .progress import show_work

if TYPE_CHECKING:
    from ..config import Bus
    from ..simulation.trial import Trial


_PATIENCE_S = 1.0  # how long to wait for a full transmit queue


class ScenarioName(StrEnum):
    """The names in simulation/scenarios; that module takes too long to import for a help text."""

    walk = "walk"
    stand = "stand"
    t1 = "t1"
    t2 = "t2"
    t3 = "t3"
    t4 = "t4"
    t5 = "t5"
    t6 = "t6"
    vacuum = "vacuum"
    plenum = "plenum"


def simulate(
    scenario: Annotated[
        ScenarioName,
        typer.Argument(
            case_sensitive=False,
            help="walk and stand go on for ever; t1 to t6 are the published tasks (still on both feet, on the left, "
            "slow movements, three walks); vacuum and plenum are chambers.",
        ),
    ] = ScenarioName.walk,
    bus: OptionalBusName = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder of the recording.")] = None,
    effects: Annotated[
        Path | None, typer.Option("--effects", help="insole-effects/1: physics of the sensors beyond a static curve.")
    ] = None,
    trial_file: Annotated[
        Path | None,
        typer.Option("--trial", help="insole-trial/1: the person, chamber, temperature, instruments and faults."),
    ] = None,
    config: ConfigFile = None,
    seconds: Seconds = None,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of every random draw: same seed, same insole, same frames.")
    ] = 0,
    force: Force = False,
) -> None:
    """Simulate insoles: their boards live on a bus, where they obey commands, or a trial as a recording."""
    if (bus is None) == (out is None):
        raise typer.BadParameter("expected one of --bus (such as socketcan:can0) and --out, found both or neither")
    from .. import config as configs
    from ..service.foot_setup import load_layout
    from ..simulation import conditions, effects_file
    from ..simulation.trial import Trial

    settings = configs.load(config)
    layouts = [load_layout(insole) for insole in settings.insoles]
    physics = effects_file.load(effects, layouts) if effects is not None else None
    chosen = conditions.load(trial_file) if trial_file is not None else None
    trial = Trial(scenario.value, settings, layouts, effects=physics, conditions=chosen, seed=seed)
    if out is not None:
        with replace_folder(out, force, is_repeatable), show_work(f"simulating {scenario.value}") as work:
            path = trial.write(out, seconds, work.done)
        print(f"insole: {scenario.value} ({trial.scenario.about}) written into {path}", file=sys.stderr)
        name_next(f"insole report {path}")
    elif bus is not None:
        _play(trial, bus, trial.length_s(seconds))


def _play(trial: Trial, bus: Bus, seconds: float | None) -> None:
    from ..bus.frames import FrameBatch
    from ..bus.opening import open_as_boards

    stop = threading.Event()
    on_end(stop.set)
    source = open_as_boards(bus)
    sink = source.sink(_PATIENCE_S)

    def received() -> FrameBatch:
        source.receive()
        return source.drain()

    try:
        print(f"insole: {trial.scenario.about}, on {bus}", file=sys.stderr, flush=True)
        name_next("insole run, on the same bus, in another terminal")
        sent = trial.emulator.play(sink.send, stop, seconds, received)
    finally:
        source.close()
    print(f"insole: {sent} frames sent", file=sys.stderr)
