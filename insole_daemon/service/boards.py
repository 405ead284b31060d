"""The operations of `insole boards` on one foot's boards: list, configure, start, stop, temperature.

Boards do not acknowledge settings. Each operation therefore checks the stream (skin.confirmation) and replies whether
it confirms them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from ..errors import BusError, WireError
from ..skin import commands
from ..skin.boards import BoardSurvey
from ..skin.bus_load import BusLoad, check_fits
from ..skin.commands import Identity
from ..skin.confirmation import ObservedBoard
from ..untrusted import quoted
from .board_link import BoardLink
from .load import FootLoad
from .operations import Operation, Step, pause

_TEMPERATURE_NS = 3_000_000_000  # the boards are asked for one reading a second
_STARTED_NS = 500_000_000
_STOPPED_NS = 300_000_000


Tell = Callable[[str, str, Collection[int]], None]  # publishes an event: kind, text, boards


@dataclass(frozen=True, slots=True)
class LoadBefore:
    """The load on the foot before a command that may make boards take a new baseline."""

    load: FootLoad
    known: bool

    @property
    def words(self) -> str:
        """The load in words, for an event."""
        if self.load.loaded:
            return f"{self.load.words}, forced"
        return self.load.words if self.known else "its load is not known, the boards were silent before"

    @property
    def reply(self) -> dict[str, Any]:
        """The load as keys of the reply."""
        load = "loaded" if self.load.loaded else "none" if self.known else "not known"
        return {"load": load, "force_n": self.load.force_n}


class BoardOperations:
    """Handles requests for one foot's boards, and remembers what this daemon has configured or stopped."""

    def __init__(self, link: BoardLink, tell: Tell) -> None:
        self.link, self.tell = link, tell
        self.configured: set[int] = set()  # addresses that this daemon has configured
        self.stopped = False  # whether this daemon has stopped the streams: silence is then intended
        self.occupied: str | None = None  # the operation in progress, for the refusal of a second one
        self._verbs: dict[str, tuple[Callable[..., Operation], set[str]]] = {
            "list": (self.list, set()),
            "configure": (self.configure, {"force"}),
            "start": (self.start, {"force"}),
            "stop": (self.stop, set()),
            "temperature": (self.temperature, set()),
        }

    def handle(self, request: dict[str, Any]) -> Operation:
        """Return the operation for a request; raises WireError if there is no such operation."""
        verb, arguments = request.get("do"), {word: value for word, value in request.items() if word != "do"}
        if not isinstance(verb, str) or verb not in self._verbs:
            raise WireError(f"boards: expected do: one of {', '.join(self._verbs)}, found {quoted(verb)}")
        make, known = self._verbs[verb]
        if not arguments.keys() <= known:
            raise WireError(
                f"boards: {verb} takes {sorted(known) or 'no arguments'}, found {quoted(sorted(arguments))}"
            )
        if not all(isinstance(value, bool) for value in arguments.values()):
            raise WireError(f"boards: {verb}: force is true or false, found {quoted(arguments)}")
        return self._alone(verb, make(**arguments))

    def list(self) -> Operation:
        """Reply with the identity and the stream of every board."""
        link = self.link
        step = yield
        identities: dict[int, Identity] = {}
        notes = []
        try:
            link.check_open()
            step, identities = yield from self._identify(step)
        except BusError as error:
            notes.append(f"boards were not asked what they are: {error}")
        survey, stale_after_ns = BoardSurvey(link.foot.layout), link.foot.stale_after_ns
        survey(link.assembler, step.now_mono_ns, stale_after_ns)
        step, seen = yield from link.watch(step, link.boards)
        reports = {report.address: report for report in survey(link.assembler, step.now_mono_ns, stale_after_ns)}
        configured = {board.address for insole in link.foot.config.insoles for board in insole.boards}
        entries = []
        for address, board in link.boards.items():
            report = reports.get(address)
            entries.append(
                _identity(identities.get(address))
                | _entry(address, seen[address])
                | {
                    "interface": board.interface,
                    "state": report.state if report else "not in the layout",
                    "rate_hz": report.rate_hz if report else 0.0,
                    "change_rate_hz": report.change_rate_hz if report else 0.0,
                    "period_ms": board.period_ms,
                    "no_load": board.no_load,
                    "expected_triangles": link.triangles[address],
                    "configured_here": address in self.configured,
                    "differences": seen[address].differences(board, link.triangles[address]),
                }
            )
        strangers = [
            _identity(identity) | {"address": address}
            for address, identity in sorted(identities.items())
            if address not in configured
        ]
        return {"boards": entries, "strangers": strangers, "bus": _buses(link.loads()), "notes": notes}

    def configure(self, force: bool = False) -> Operation:
        """Send the boards their settings, start them, and check by their streams whether they apply them.

        Refused if the streams do not fit on the bus, and while the foot is loaded unless `force`.
        """
        link = self.link
        step = yield
        link.check_open()
        for board in link.boards.values():
            commands.configuration(board, link.triangles[board.address])  # raises before anything is sent
        for load in link.loads():
            check_fits(load)
        step, before = yield from self._load_before(step, force, "Configuring takes the boards' hardware baseline anew")
        step, seen = yield from self.apply(step, link.boards, before.words)
        entries, confirmed = self._verdicts(seen, rest=True)
        self._tell_verdict(entries, confirmed)
        return {"confirmed": confirmed, **before.reply, "boards": entries, "bus": _buses(link.loads())}

    def apply(
        self, step: Step, addresses: Collection[int], load_words: str
    ) -> Generator[None, Step, tuple[Step, dict[int, ObservedBoard]]]:
        """Publish an event, configure and start the boards, and return what they send afterwards."""
        self.tell(
            "boards_configuring",
            f"{_boards(addresses)} {_are(addresses)} configured: the hardware baseline is taken anew, what presses on "
            f"the {self.link.foot.name} foot now reads as no load from now on ({load_words})",
            addresses,
        )
        step = yield from self.link.apply(step, addresses)
        self.configured |= set(addresses)
        self.stopped = False
        return (yield from self.link.watch(step, addresses))

    def start(self, force: bool = False) -> Operation:
        """Start the streams.

        Refused while the foot is loaded unless `force`: a board that has lost power (MTB4) takes its hardware baseline
        with the first of these commands, whichever it is.
        """
        step = yield
        self.link.check_open()
        step, before = yield from self._load_before(
            step, force, "A board that has lost power takes its hardware baseline when it is started"
        )
        self.tell(
            "boards_starting",
            f"{_boards(self.link.boards)} {_are(self.link.boards)} started: {self._zeroes_words()} ({before.words})",
            self.link.boards,
        )
        step = yield from self.link.send_all(step, {a: [commands.transmit(a, True)] for a in self.link.boards})
        self.stopped = False
        step, seen = yield from self.link.watch(step, self.link.boards)
        entries, _ = self._verdicts(seen, rest=False)
        for entry in entries:
            entry["confirmed"] = bool(entry["triangles"])
        self.tell("boards_started", f"{_boards(self.link.boards)}: told to send", self.link.boards)
        return {"confirmed": all(entry["confirmed"] for entry in entries), **before.reply, "boards": entries}

    def stop(self) -> Operation:
        """Stop the streams; the boards keep their settings and baselines as long as they keep power.

        Not refused under load: a board that sends has a baseline already. For a silent board, an event states that it
        may take one now.
        """
        step = yield
        self.link.check_open()
        silent = [address for address in self.link.boards if not self.link.is_streaming(address, step.now_mono_ns)]
        if silent:
            self.tell(
                "boards_stopping",
                f"{_boards(silent)} {_are(silent)} silent already and told to be: {self._zeroes_words()}",
                silent,
            )
        step = yield from self.link.send_all(step, {a: [commands.transmit(a, False)] for a in self.link.boards})
        self.stopped = True
        step = yield from pause(step, _STOPPED_NS)
        step, seen = yield from self.link.watch(step, self.link.boards, 0)
        entries = []
        for address in self.link.boards:
            sends = bool(seen[address].triangles)
            entries.append(
                _entry(address, seen[address])
                | {"confirmed": not sends, "differences": ["still sends"] if sends else []}
            )
        self.tell("boards_stopped", f"{_boards(self.link.boards)}: told to be silent", self.link.boards)
        return {"confirmed": all(entry["confirmed"] for entry in entries), "boards": entries}

    def temperature(self) -> Operation:
        """Read the thermometers of the boards that have one (MTB4)."""
        link = self.link
        step = yield
        link.check_open()
        step, identities = yield from self._identify(step)
        answered = [address for address in link.boards if address in identities]
        asked = [a for a in answered if identities[a].board_type not in commands.WITHOUT_THERMOMETER]
        temperatures_c: dict[int, float] = {}
        if asked:
            step = yield from link.send_all(step, {a: [commands.thermometer_configuration(a)] for a in asked})
            for address in asked:  # all at once: an answer may arrive during the pauses of send_all
                link.send(address, commands.thermometer_period(address, 1))
            step, temperatures_c = yield from link.answers(step, commands.read_temperature, asked, _TEMPERATURE_NS)
            step = yield from link.send_all(step, {a: [commands.thermometer_period(a, 0)] for a in asked})
        entries = []
        for address in link.boards:
            why = (
                None if address in temperatures_c
                else "does not answer" if address not in identities
                else f"type {identities[address].name} has no thermometer" if address not in asked
                else "sends no temperature"
            )  # fmt: skip
            reading = {"address": address, "why": why, "temperature_c": temperatures_c.get(address)}
            entries.append(_identity(identities.get(address)) | reading)
        without = [address for address in answered if address not in asked]
        return {"confirmed": len(temperatures_c) + len(without) == len(link.boards), "boards": entries}

    def _alone(self, verb: str, operation: Operation) -> Operation:
        """Run `operation`; raises BusError if another one is in progress."""
        if self.occupied is not None:
            raise BusError(f"the boards are busy: {self.occupied}. Try again when that is done")
        self.occupied = f"{verb} runs"
        try:
            return (yield from operation)
        finally:
            self.occupied = None

    def _identify(self, step: Step) -> Generator[None, Step, tuple[Step, dict[int, Identity]]]:
        """Return the identities by address, from discovery and, where a board answers it, from the version query."""
        self.link.discover()
        # Boards that are not in the configuration may answer as well, so the whole time is waited for.
        step, identities = yield from self.link.answers(step, commands.read_discovery)
        for address in self.link.boards:
            self.link.send(address, commands.version_query(address))
        step, versions = yield from self.link.answers(step, commands.read_version, self.link.boards)
        return step, identities | versions

    def _load_before(self, step: Step, force: bool, cost: str) -> Generator[None, Step, tuple[Step, LoadBefore]]:
        """Return the load on the foot. Raises BusError, which states the `cost`, if the foot is loaded, unless `force`.

        If all boards are silent they are started first. A board with a baseline then shows the load relative to it. A
        board that was just powered takes its baseline with this first command, whatever the load, and shows none; an
        event is published before.
        """
        link = self.link
        known = any(link.is_streaming(address, step.now_mono_ns) for address in link.boards)
        if not known:
            self.tell(
                "boards_starting",
                f"{_boards(link.boards)} {_are(link.boards)} started to look at the load: {self._zeroes_words()} (its "
                "load is not known, the boards were silent before)",
                link.boards,
            )
            step = yield from link.send_all(step, {a: [commands.transmit(a, True)] for a in link.boards})
            step = yield from pause(step, _STARTED_NS)
        step, load = yield from link.look(step)
        if not known and load.loaded:
            step = yield from link.send_all(step, {a: [commands.transmit(a, False)] for a in link.boards})
        if load.loaded and not force:
            raise BusError(
                f"the {link.foot.name} foot is loaded: {load.words} (unloaded is below {load.min_force_n:g} N for "
                f"1.5 s). {cost}, and that load would read as none from then on. Lift the foot and ask again; or "
                "insist with force (--force) if you know better"
            )
        return step, LoadBefore(load, known and load.force_n is not None)

    def _zeroes_words(self) -> str:
        return (
            "one that has lost power takes its hardware baseline now, and what presses on the "
            f"{self.link.foot.name} foot reads as no load on it from now on"
        )

    def _verdicts(self, seen: dict[int, ObservedBoard], rest: bool) -> tuple[Sequence[dict[str, Any]], bool]:
        entries = []
        for address, observed in seen.items():
            board = self.link.boards[address]
            differences = observed.differences(board, self.link.triangles[address])
            if rest:
                differences += observed.rest_difference(board)
            entries.append(_entry(address, observed) | {"confirmed": not differences, "differences": differences})
        return entries, all(entry["confirmed"] for entry in entries)

    def _tell_verdict(self, entries: Sequence[dict[str, Any]], confirmed: bool) -> None:
        wrong = [f"board {e['address']} {'; '.join(e['differences'])}" for e in entries if e["differences"]]
        text = "their streams confirm it" if confirmed else "not confirmed: " + ", ".join(wrong)
        self.tell(
            "boards_configured" if confirmed else "boards_not_confirmed",
            f"{_boards([e['address'] for e in entries])} configured, {text}",
            [e["address"] for e in entries],
        )


def _entry(address: int, seen: ObservedBoard) -> dict[str, Any]:
    """Return the keys of a reply that describe a board's stream."""
    return {
        "address": address,
        "triangles": list(seen.triangles),
        "open_triangles": list(seen.open_triangles),
        "seen_period_ms": seen.period_ms,
        "seen_count": seen.rest_count,
        "legacy": seen.legacy,
    }


def _identity(identity: Identity | None) -> dict[str, Any]:
    if identity is None:
        return {"type": None, "firmware": None, "protocol": None, "bootloader": None}
    return {
        "type": identity.name,
        "firmware": ".".join(map(str, identity.firmware)),
        "protocol": ".".join(map(str, identity.protocol)) if identity.protocol else None,
        "bootloader": identity.bootloader,
    }


def _buses(loads: Sequence[BusLoad]) -> Sequence[dict[str, Any]]:
    return [asdict(load) | {"streams": [asdict(stream) for stream in load.streams]} for load in loads]


def _boards(addresses: Collection[int]) -> str:
    return f"board{'s' if len(addresses) > 1 else ''} {', '.join(map(str, sorted(addresses)))}"


def _are(addresses: Collection[int]) -> str:
    return "are" if len(addresses) > 1 else "is"
