"""`insole bring-up`: guide the first hour with real boards and write one report."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .doctor import finding_lines
from .options import ConfigFile, Which, name_next, on_end, write_whole
from .progress import show_work

if TYPE_CHECKING:
    from ..bring_up.observation import Observation
    from ..bring_up.report import Report
    from ..bus.recovering import RecoveringSource
    from ..config import Config
    from ..recording.recorder import Progress
    from ..service.doctor import CheckResult
    from ..service.foot_setup import FootSetup

_LISTEN_S = 10.0


def bring_up(
    config: ConfigFile = None,
    foot: Annotated[Which, typer.Option("--foot", help="Insoles to check.")] = Which.both,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder of the report; left out: bring-up- and the time.")
    ] = None,
    mass_kg: Annotated[float | None, typer.Option("--mass", min=10, max=300, help="Body mass in kg.")] = None,
    seconds: Annotated[float, typer.Option("--seconds", min=1, help="How long is recorded.")] = 60.0,
) -> None:
    """Guide the first hour with real boards, step by step, and write a report that can be sent.

    It only receives: it configures no board and sends no frame. It asks before each step; without a terminal it runs
    only the steps that need no person. Exit status 1: there is a problem, with its remedy.
    """
    from .. import config as configs
    from ..bring_up.report import Report
    from ..bus.recovering import RecoveringSource
    from ..errors import InsoleError
    from ..recording.writer import refuse_existing
    from ..service.foot_setup import load_setups

    settings = configs.load(config)
    setups = [setup for setup in load_setups(settings) if foot in (Which.both, setup.insole.foot)]
    if not setups:
        raise InsoleError(f"the configuration has no {foot.value} foot: correct --foot, or the configuration")
    folder = out or Path(time.strftime("bring-up-%Y%m%d-%H%M%S"))
    refuse_existing(folder)
    report = Report(config.read_text() if config is not None else "# the built-in configuration")
    stop = threading.Event()
    on_end(stop.set)
    _report_step(report, "bus", list(_check_interfaces(settings)))
    with contextlib.closing(RecoveringSource(settings.buses)) as source:
        _all_steps(report, source, settings, setups, folder, mass_kg, seconds, stop)
    file = folder / "report.md"
    write_whole(file, report.text())
    n, with_config = len(report.problems), f" --config {config}" if config else ""
    print(f"insole: {n} problem{'s' * (n != 1)}; the report is {file}: send it to us with the folder", file=sys.stderr)
    if report.problems:
        name_next(f"the changes in the report under 'What to change'; then insole bring-up{with_config}")
        raise typer.Exit(1)
    name_next(f"insole run{with_config}")


def _check_interfaces(settings: Config) -> Iterator[CheckResult]:
    from ..service.doctor import can

    if any(bus.driver == "socketcan" for bus in settings.buses):
        yield from can.check_kernel()
    for bus in settings.buses:
        if bus.driver == "socketcan":
            yield from can.check_interface(bus, settings.boards.configure)


def _all_steps(
    report: Report,
    source: RecoveringSource,
    settings: Config,
    setups: Sequence[FootSetup],
    folder: Path,
    mass_kg: float | None,
    seconds: float,
    stop: threading.Event,
) -> None:
    """Run every step in order; if no board sends, only the first one."""
    import dataclasses

    from ..bring_up import judgement, steps

    _print_progress(f"listening for {_LISTEN_S:g} s: take the insoles off, nothing presses on them")
    observation = _listen(source, setups, _LISTEN_S, stop)
    chosen = dataclasses.replace(settings, insoles=tuple(setup.insole for setup in setups))
    _report_step(
        report, "boards", list(judgement.judge_observation(observation, chosen, [setup.layout for setup in setups]))
    )
    if not observation.boards():
        report.notes["recording"] = "Not done: no board sends."
        return
    if _confirm_step("press every triangle in turn, which finds out where it lies"):
        _report_step(report, "mapping", _map_triangles(source, setups, folder, stop))
    if not stop.is_set() and _confirm_step("take the zero: lift both feet, and keep still"):
        observation = _listen(source, setups, steps.ZERO_S, stop)
        setups, findings = steps.take_zero(observation, setups)
        _report_step(report, "zero", findings)
    if not stop.is_set():
        _print_progress(f"recording {seconds:g} s into {folder / 'recording'}: walk about, if you like")
        findings = steps.record_trial(
            source, setups, folder / "recording", seconds, stop, lambda progress: _print_time_left(progress, seconds)
        )
        _report_step(report, "recording", findings)
    for at, setup in enumerate(setups):
        if not stop.is_set() and _confirm_step(f"stand on the {setup.insole.foot} foot alone, for {steps.FORCE_S:g} s"):
            mass_kg = mass_kg or _ask_mass_kg()
            if mass_kg is not None:
                observation = _listen(source, setups, steps.FORCE_S, stop)
                _report_step(report, "force", [steps.stand_on_one_foot(observation, setups, at, mass_kg)])


def _listen(
    source: RecoveringSource, setups: Sequence[FootSetup], seconds: float, stop: threading.Event
) -> Observation:
    from ..bring_up import steps

    with show_work("listening") as work:
        return steps.listen(source, setups, seconds, stop, work.done)


def _map_triangles(
    source: RecoveringSource, setups: Sequence[FootSetup], folder: Path, stop: threading.Event
) -> list[CheckResult]:
    """Run the mapping wizard and return its differences from the layouts in use, as findings."""
    from ..bring_up.judgement import judge_placement
    from ..service.doctor.finding import problem
    from ..skin.mapping import Mapping, positions
    from ..skin.mapping_result import summary
    from ..skin.touch import Touch
    from .map import watch_presses, write_layouts

    owners = {board.address: setup.insole.foot for setup in setups for board in setup.insole.boards}
    layouts = [setup.layout for setup in setups]
    targets = [position for layout in layouts for position in positions(layout)]
    touch, mapping = Touch(), Mapping(targets, owners)
    watch_presses(source, touch, mapping, targets, stop)
    placements = mapping.results()
    findings = [finding for layout in layouts for finding in judge_placement(layout, placements)]
    findings += [
        problem("mapping", line, "insole map   # repeats it alone") for line in summary(placements, owners, [], [])
    ]
    if mapping.is_done:
        write_layouts(folder, layouts, placements, owners, touch)
    return findings


def _print_time_left(progress: Progress, seconds: float) -> None:
    if sys.stderr.isatty():
        print(f"\r  {max(0.0, seconds - progress.seconds):.0f} s left\033[K", end="", file=sys.stderr, flush=True)


def _report_step(report: Report, name: str, findings: Sequence[CheckResult]) -> None:
    """Add the findings of a step to the report and print them."""
    report.add(name, findings)
    for finding in findings:
        sys.stdout.write(finding_lines(finding))
    sys.stdout.flush()


def _confirm_step(step: str) -> bool:
    """Ask whether to run the next step; False without a terminal."""
    if not sys.stdin.isatty():
        return False
    return input(f"Next: {step}. Do it? [Y/n] ").strip().lower() in ("", "y", "yes")


def _ask_mass_kg() -> float | None:
    try:
        return float(input("Body mass in kg: ").replace(",", "."))
    except ValueError:
        return None


def _print_progress(text: str) -> None:
    print(f"insole: {text}", file=sys.stderr, flush=True)
