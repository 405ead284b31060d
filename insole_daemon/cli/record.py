"""`insole record`: record a trial into a folder."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from ..config import DEFAULT_ENDPOINT
from ..errors import BusError
from .options import ConfigFile, Connect, Seconds, Which, name_next, on_end

if TYPE_CHECKING:
    from ..config import Config, Foot
    from ..recording.copies import InsoleContents
    from ..recording.coverage import Item, Protocol
    from ..recording.instrument import Instrument
    from ..recording.recorder import Progress, Session
    from ..wire.client import Client

_QUIET_S = 10  # between two lines without a terminal


class RecordKind(StrEnum):
    """The kind of reference instrument."""

    chamber = "chamber"
    shoe = "shoe"
    bench = "bench"
    free = "free"


def record(
    out: Annotated[Path, typer.Argument(help="Folder of the recording; it must not exist yet.")],
    config: ConfigFile = None,
    remote: Annotated[
        bool, typer.Option("--remote", help="Record the cycles a daemon publishes over Zenoh, not a bus.")
    ] = False,
    connect: Connect = DEFAULT_ENDPOINT,
    rig: Annotated[str, typer.Option(help="With --remote: which wearer, if there are several.")] = "*",
    foot: Annotated[Which, typer.Option("--foot", help="Insoles to record.")] = Which.both,
    kind: Annotated[RecordKind, typer.Option(help="Kind of reference; free: none.")] = (RecordKind.free),
    reference: Annotated[
        list[str] | None,
        typer.Option(
            help="Source of the reference: - for lines of CSV on standard input, else a Zenoh key of JSON "
            "objects; left=… or right=… if two feet are recorded. May be repeated."
        ),
    ] = None,
    shoe: Annotated[
        list[Path] | None, typer.Option(help="insole-shoe/1: combines a force shoe's two sensors into one wrench.")
    ] = None,
    guided: Annotated[
        bool,
        typer.Option(
            "--guided", help="Show what to do next, and which loads that distinguish effects are covered so far."
        ),
    ] = False,
    rotate_mb: Annotated[
        float | None, typer.Option(min=0.1, help="Continue in OUT-2, OUT-3 … after this many megabytes.")
    ] = None,
    seconds: Seconds = None,
) -> None:
    """Record a trial into a folder, from a bus or over Zenoh.

    The recorder reads the bus in addition to a running daemon. Received data is on disk within a second; a killed
    recorder leaves a folder that can be read.
    """
    from .. import config as configs
    from ..bus.recovering import RecoveringSource
    from ..recording.guide import Guide
    from ..recording.live import LiveRecorder
    from ..recording.recorder import Session
    from ..recording.writer import refuse_existing
    from ..wire.client import Client

    refuse_existing(out)
    if (kind is RecordKind.free) != (not reference):
        raise typer.BadParameter("--kind chamber, shoe or bench and --reference belong together: give both")
    stop = threading.Event()
    on_end(stop.set)
    with ExitStack() as opened:
        client = None
        if remote or any(_reference_key(item) != "-" for item in reference or ()):
            client = opened.enter_context(Client(connect, rig))
        if remote:
            assert client is not None
            insoles, interfaces = _insoles_of_daemon(client, connect, foot), None
        else:
            settings = configs.load(config)
            insoles = insoles_of(settings, foot)
        instruments = _instruments([item.foot for item in insoles], kind, reference or [], shoe or [])
        if not remote:
            try:
                source = RecoveringSource(settings.buses)
            except BusError as error:
                raise BusError(f"{error}. To record what a running daemon or demo publishes, add --remote") from error
            opened.callback(source.close)
            interfaces = source.interfaces
        rotate_bytes = None if rotate_mb is None else round(rotate_mb * 1e6)
        recorder = LiveRecorder(out, kind.value, insoles, len(instruments), interfaces, rotate_bytes)
        opened.callback(recorder.close)
        printer = ProgressPrinter(out, seconds)
        guide = Guide(insoles, kind.value, protocol_of(kind)) if guided else None
        session = Session(recorder, stop, seconds, printer, printer.note, [item for item, _ in instruments], guide)
        _read_references(session, instruments, client)
        origin = f"a daemon on {connect}" if remote else ", ".join(map(str, settings.buses))
        print(f"insole: recording {origin} into {out}; Ctrl-C ends", file=sys.stderr, flush=True)
        if remote:
            assert client is not None
            raws = client.raws(foot.value if foot is not Which.both else "*")
            progress = session.from_daemon(raws)
        else:
            progress = session.from_bus(source)
    printer.end(progress)
    if progress.frames or progress.cycles:
        name_next(f"insole report {out}")


def protocol_of(kind: RecordKind) -> Protocol:
    """Return the loads that a trial of `kind` has to cover: nobody walks in a chamber or under a press."""
    from ..recording.coverage import Protocol

    return Protocol(steps=0) if kind in (RecordKind.chamber, RecordKind.bench) else Protocol()


def insoles_of(settings: Config, foot: Which = Which.both) -> list[InsoleContents]:
    """Return the insoles of a configuration with the zeros in use, as a recording stores them."""
    from ..errors import InsoleError
    from ..recording.copies import InsoleContents
    from ..service.foot import load_feet

    insoles = [
        InsoleContents(
            foot_state.name,
            foot_state.insole.boards,
            foot_state.layout,
            foot_state.insole.calibration or foot_state.calibration,
            foot_state.zero,
        )
        for foot_state in load_feet(settings)
        if foot in (Which.both, foot_state.name)
    ]
    if not insoles:
        raise InsoleError(f"the configuration has no {foot.value} foot: correct --foot, or the configuration")
    return insoles


def _insoles_of_daemon(client: Client, connect: str, foot: Which) -> list[InsoleContents]:
    from ..errors import WireError
    from ..recording.daemon_insole import insole_in_use

    published = [(rig, name) for rig, name in client.feet() if foot in (Which.both, name)]
    if not published:
        raise WireError(f"no daemon behind {connect} has the foot that is to be recorded ({foot.value})")
    rigs = sorted({rig for rig, _ in published})
    if len(rigs) > 1:
        raise WireError(f"{' and '.join(rigs)} publish behind {connect}: choose one with --rig")
    client.rig = rigs[0]  # a rig that appears later is another wearer
    return [insole_in_use(client, name) for _, name in published]


def _reference_key(reference: str) -> str:
    """Return the source of a reference without the foot before it."""
    foot, equals, rest = reference.partition("=")
    return rest if equals and foot in ("left", "right") else reference


def _instruments(
    feet: Sequence[Any], kind: RecordKind, references: Sequence[str], shoes: Sequence[Path]
) -> list[tuple[Instrument, str]]:
    """Return each instrument with the source of its readings."""
    from ..recording.force_shoe import load
    from ..recording.instrument import Instrument

    shoe_of: dict[str, Any] = {}
    for shoe in map(load, shoes):
        shoe_of[shoe.foot] = shoe
    if shoes and kind is not RecordKind.shoe:
        raise typer.BadParameter(f"--shoe goes with --kind shoe, found --kind {kind.value}")
    instruments: list[tuple[Instrument, str]] = []
    for reference in references:
        key = _reference_key(reference)
        foot = reference.partition("=")[0] if key != reference else feet[0] if len(feet) == 1 else None
        if foot is None or foot not in feet or any(foot == instrument.foot for instrument, _ in instruments):
            raise typer.BadParameter(
                f"--reference {reference}: expected left=… or right=…, once for each recorded foot ({', '.join(feet)})"
            )
        instruments.append((Instrument(cast("Foot", foot), kind.value, shoe_of.get(foot)), key))
    return instruments


def _read_references(session: Session, instruments: Sequence[tuple[Instrument, str]], client: Client | None) -> None:
    from ..recording.recorder import read_lines, with_time

    for instrument, key in instruments:
        items: Iterator[Any] = read_lines(sys.stdin.fileno())
        if key != "-":
            assert client is not None
            items = client.payloads(key)
        session.merged_queue.read(instrument, with_time(items))


class ProgressPrinter:
    """Prints the progress: a line rewritten in place on a terminal, otherwise a line now and then.

    With `--guided` it prints the next instruction when that changes, and the coverage as a line of JSON on standard
    output whenever it has grown, unless that is a terminal.
    """

    def __init__(self, out: Path, seconds: float | None) -> None:
        self._out, self._seconds = out, seconds
        self._is_terminal = sys.stderr.isatty()
        self._calls = 0
        self._instructions: dict[Foot, str] = {}
        self._coverage_json = ""

    def __call__(self, progress: Progress) -> None:
        """Print the progress; called once a second."""
        self._calls += 1
        self._print_guidance(progress)
        if self._is_terminal:
            print(f"\r{self._text_with_time_left(progress)}\033[K", end="", file=sys.stderr, flush=True)
        elif self._calls % _QUIET_S == 0:
            print(f"insole: {self._text_with_time_left(progress)}", file=sys.stderr, flush=True)

    def note(self, text: str) -> None:
        """Print a message above the progress line."""
        print("\r\033[K" * self._is_terminal + f"insole: {text}", file=sys.stderr, flush=True)

    def end(self, progress: Progress) -> None:
        """Print the result at the end."""
        self._print_guidance(progress)
        start = "\r\033[K" if self._is_terminal else ""
        print(f"{start}insole: recorded {_progress_text(progress)} in {self._out}", file=sys.stderr, flush=True)
        for foot, quality in progress.quality.items():
            print(f"insole: {foot}: {quality.sentence}", file=sys.stderr)
        for foot, items in progress.covered.items():
            missing = [f"{item.name} ({item.seen} so far: {item.ask})" for item in items if item.done < 1.0]
            print(f"insole: {foot}: missing: {'; '.join(missing) or 'nothing'}", file=sys.stderr)
        if not (progress.frames or progress.cycles):
            print("insole: nothing came: are the boards powered and started?", file=sys.stderr)

    def _text_with_time_left(self, progress: Progress) -> str:
        if self._seconds is None:
            return _progress_text(progress)
        return f"{_progress_text(progress)}, {max(0.0, self._seconds - progress.seconds):.0f} s left"

    def _print_guidance(self, progress: Progress) -> None:
        for foot, items in progress.covered.items():
            ask = next((item.ask for item in items if item.done < 1.0), "all is covered: Ctrl-C ends")
            if self._instructions.get(foot) != ask:
                self._instructions[foot] = ask
                self.note(f"{foot}: {ask}")
        if progress.covered and not sys.stdout.isatty():
            covered = json.dumps(
                {foot: [_coverage_dict(item) for item in items] for foot, items in progress.covered.items()}
            )
            if covered != self._coverage_json:
                self._coverage_json = covered
                print(covered, flush=True)


def _coverage_dict(item: Item) -> dict[str, Any]:
    return {"name": item.name, "done": round(item.done, 2), "seen": item.seen, "ask": item.ask}


def _progress_text(progress: Progress) -> str:
    amount = f"{progress.cycles} cycles" if progress.cycles else f"{progress.frames} frames"
    words = [f"{progress.seconds:.0f} s", amount, f"{progress.bytes / 1e6:.1f} MB"]
    words += [f"{foot} {quality.verdict} ({quality.percent} %)" for foot, quality in progress.quality.items()]
    if progress.lost:
        words.append(f"{progress.lost} lost")
    if progress.folders > 1:
        words.append(f"{progress.folders} folders")
    for foot, items in progress.covered.items():
        current = next((f" ({item.name}: {item.seen})" for item in items if item.done < 1.0), "")
        words.append(f"{foot} {sum(item.done >= 1.0 for item in items)} of {len(items)} covered{current}")
    for instrument in progress.instruments:
        words.append(f"reference {instrument.foot} {instrument.readings} rows")
        if instrument.refused:
            words.append(f"{instrument.refused} refused ({instrument.refusal})")
    return ", ".join(words)
