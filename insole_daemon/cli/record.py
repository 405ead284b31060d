"""`insole record`: a trial into a folder, while it happens."""

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
from .options import ConfigFile, Connect, Seconds, Which, name_next, on_end

if TYPE_CHECKING:
    from ..config import Config, Foot
    from ..recording.copies import InsoleContents
    from ..recording.coverage import Item, Protocol
    from ..recording.instrument import Instrument
    from ..recording.recorder import Progress, Session
    from ..wire.client import Client

_QUIET_S = 10  # between two lines where nobody watches a terminal


class RecordKind(StrEnum):
    """What the reference instrument measures."""

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
    rig: Annotated[str, typer.Option(help="With --remote: which wearer, where there are several.")] = "*",
    foot: Annotated[Which, typer.Option("--foot", help="Which insoles the recording is of.")] = Which.both,
    kind: Annotated[RecordKind, typer.Option(help="What the reference measures; free: there is none.")] = (
        RecordKind.free
    ),
    reference: Annotated[
        list[str] | None,
        typer.Option(
            help="Where the reference comes from: - for lines of CSV on standard input, else a Zenoh key of JSON "
            "objects; left=… or right=… where two feet are recorded. May be repeated."
        ),
    ] = None,
    shoe: Annotated[
        list[Path] | None, typer.Option(help="insole-shoe/1: makes one wrench of a force shoe's two sensors.")
    ] = None,
    guided: Annotated[
        bool,
        typer.Option(
            "--guided", help="Say what to do next and what is covered so far of what tells the sensor's effects apart."
        ),
    ] = False,
    rotate_mb: Annotated[
        float | None, typer.Option(min=0.1, help="Go on in OUT-2, OUT-3 … after so many megabytes.")
    ] = None,
    seconds: Seconds = None,
) -> None:
    """Record a trial into a folder, from a bus or over Zenoh.

    A bus is read beside the daemon, if there is one. What was received is on disk within a second; a recorder that was
    killed leaves a folder that can be read.
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
        if remote or any(_key(each) != "-" for each in reference or ()):
            client = opened.enter_context(Client(connect, rig))
        if remote:
            assert client is not None
            insoles, interfaces = _of_daemon(client, connect, foot), None
        else:
            settings = configs.load(config)
            insoles = insoles_of(settings, foot)
        instruments = _instruments([each.foot for each in insoles], kind, reference or [], shoe or [])
        if not remote:
            source = RecoveringSource(settings.buses)
            opened.callback(source.close)
            interfaces = source.interfaces
        rotate_bytes = None if rotate_mb is None else round(rotate_mb * 1e6)
        recorder = LiveRecorder(out, kind.value, insoles, len(instruments), interfaces, rotate_bytes)
        opened.callback(recorder.close)
        told = Telling(out, seconds)
        guide = Guide(insoles, kind.value, protocol_of(kind)) if guided else None
        session = Session(recorder, stop, seconds, told, told.note, [each for each, _ in instruments], guide)
        _listen(session, instruments, client)
        what = f"a daemon on {connect}" if remote else ", ".join(map(str, settings.buses))
        print(f"insole: recording {what} into {out}; Ctrl-C ends", file=sys.stderr, flush=True)
        if remote:
            assert client is not None
            raws = client.raws(foot.value if foot is not Which.both else "*")
            progress = session.from_daemon(raws)
        else:
            progress = session.from_bus(source)
    told.end(progress)
    if progress.frames or progress.cycles:
        name_next(f"insole report {out}")


def protocol_of(kind: RecordKind) -> Protocol:
    """What a trial of that kind has to cover: nobody walks in a chamber or under a press."""
    from ..recording.coverage import Protocol

    return Protocol(steps=0) if kind in (RecordKind.chamber, RecordKind.bench) else Protocol()


def insoles_of(settings: Config, foot: Which = Which.both) -> list[InsoleContents]:
    """The insoles of a configuration, with the zeros in use, as a recording holds them."""
    from ..errors import InsoleError
    from ..recording.copies import InsoleContents
    from ..service.foot import load_feet

    insoles = [
        InsoleContents(
            each.name, each.insole.boards, each.layout, each.insole.calibration or each.calibration, each.zero
        )
        for each in load_feet(settings)
        if foot in (Which.both, each.name)
    ]
    if not insoles:
        raise InsoleError(f"the configuration has no {foot.value} foot: correct --foot, or the configuration")
    return insoles


def _of_daemon(client: Client, connect: str, foot: Which) -> list[InsoleContents]:
    from ..errors import WireError
    from ..recording.daemon_insole import insole_in_use

    found = [(rig, name) for rig, name in client.feet() if foot in (Which.both, name)]
    if not found:
        raise WireError(f"no daemon behind {connect} has the foot that is to be recorded ({foot.value})")
    rigs = sorted({rig for rig, _ in found})
    if len(rigs) > 1:
        raise WireError(f"{' and '.join(rigs)} publish behind {connect}: say which with --rig")
    client.rig = rigs[0]  # one that comes later is another wearer
    return [insole_in_use(client, name) for _, name in found]


def _key(reference: str) -> str:
    """Where a reference comes from, without the foot before it."""
    foot, equals, rest = reference.partition("=")
    return rest if equals and foot in ("left", "right") else reference


def _instruments(
    feet: Sequence[Any], kind: RecordKind, references: Sequence[str], shoes: Sequence[Path]
) -> list[tuple[Instrument, str]]:
    """The instruments and where each one's readings come from."""
    from ..recording.force_shoe import load
    from ..recording.instrument import Instrument

    shoe_of: dict[str, Any] = {}
    for shoe in map(load, shoes):
        shoe_of[shoe.foot] = shoe
    if shoes and kind is not RecordKind.shoe:
        raise typer.BadParameter(f"--shoe goes with --kind shoe, found --kind {kind.value}")
    found: list[tuple[Instrument, str]] = []
    for reference in references:
        key = _key(reference)
        foot = reference.partition("=")[0] if key != reference else feet[0] if len(feet) == 1 else None
        if foot is None or foot not in feet or any(foot == each.foot for each, _ in found):
            raise typer.BadParameter(
                f"--reference {reference}: expected left=… or right=…, once for each recorded foot ({', '.join(feet)})"
            )
        found.append((Instrument(cast("Foot", foot), kind.value, shoe_of.get(foot)), key))
    return found


def _listen(session: Session, instruments: Sequence[tuple[Instrument, str]], client: Client | None) -> None:
    from ..recording.recorder import read_lines, with_time

    for instrument, key in instruments:
        items: Iterator[Any] = read_lines(sys.stdin.fileno())
        if key != "-":
            assert client is not None
            items = client.payloads(key)
        session.merged_queue.read(instrument, with_time(items))


class Telling:
    """The progress line: rewritten in place on a terminal, else a line now and then.

    Guided, what to do next is said when that changes, and what is covered is a line of JSON on standard output whenever
    it has grown, unless that is a terminal.
    """

    def __init__(self, out: Path, seconds: float | None) -> None:
        self._out, self._seconds = out, seconds
        self._live = sys.stderr.isatty()
        self._calls = 0
        self._asked: dict[Foot, str] = {}
        self._covered = ""

    def __call__(self, progress: Progress) -> None:
        """Once a second."""
        self._calls += 1
        self._guide(progress)
        if self._live:
            print(f"\r{self._line(progress)}\033[K", end="", file=sys.stderr, flush=True)
        elif self._calls % _QUIET_S == 0:
            print(f"insole: {self._line(progress)}", file=sys.stderr, flush=True)

    def note(self, text: str) -> None:
        """What happened meanwhile."""
        print("\r\033[K" * self._live + f"insole: {text}", file=sys.stderr, flush=True)

    def end(self, progress: Progress) -> None:
        """At the end."""
        self._guide(progress)
        start = "\r\033[K" if self._live else ""
        print(f"{start}insole: recorded {_line(progress)} in {self._out}", file=sys.stderr, flush=True)
        for foot, quality in progress.quality.items():
            print(f"insole: {foot}: {quality.sentence}", file=sys.stderr)
        for foot, items in progress.covered.items():
            missing = [f"{item.name} ({item.seen} so far: {item.ask})" for item in items if item.done < 1.0]
            print(f"insole: {foot}: missing: {'; '.join(missing) or 'nothing'}", file=sys.stderr)
        if not (progress.frames or progress.cycles):
            print("insole: nothing came: are the boards powered and started?", file=sys.stderr)

    def _line(self, progress: Progress) -> str:
        if self._seconds is None:
            return _line(progress)
        return f"{_line(progress)}, {max(0.0, self._seconds - progress.seconds):.0f} s left"

    def _guide(self, progress: Progress) -> None:
        for foot, items in progress.covered.items():
            ask = next((item.ask for item in items if item.done < 1.0), "all is covered: Ctrl-C ends")
            if self._asked.get(foot) != ask:
                self._asked[foot] = ask
                self.note(f"{foot}: {ask}")
        if progress.covered and not sys.stdout.isatty():
            covered = json.dumps({foot: [_told(item) for item in items] for foot, items in progress.covered.items()})
            if covered != self._covered:
                self._covered = covered
                print(covered, flush=True)


def _told(item: Item) -> dict[str, Any]:
    return {"name": item.name, "done": round(item.done, 2), "seen": item.seen, "ask": item.ask}


def _line(progress: Progress) -> str:
    what = f"{progress.cycles} cycles" if progress.cycles else f"{progress.frames} frames"
    words = [f"{progress.seconds:.0f} s", what, f"{progress.bytes / 1e6:.1f} MB"]
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
