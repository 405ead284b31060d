"""Send commands to the boards of one foot, and read their answers and streams, in steps of the main loop."""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterable, Mapping, Sequence
from itertools import zip_longest
from typing import TypeVar

import numpy as np

from ..bus.frames import FrameBatch
from ..bus.gate import Gate
from ..config import Board
from ..errors import BusError
from ..skin import commands
from ..skin.assembler import CycleAssembler
from ..skin.bus_load import BusLoad, Stream, bus_load
from ..skin.commands import Command
from ..skin.confirmation import ObservedBoard, StreamWatch
from ..skin.identifiers import CLASS_LEGACY_SKIN, CLASS_MANAGEMENT, TYPE_THERMOMETER
from .foot import Foot
from .load import LOOK_NS, FootLoad, LoadRecord
from .operations import Step, pause

T = TypeVar("T")

PACE_NS = 10_000_000  # between frames to the boards, as the robot's own host does; no transmit queue fills
ANSWER_NS = 500_000_000
AGAIN_NS = 100_000_000  # until the triangle configuration is sent the second time, see skin.commands
_BASELINE_NS = 250_000_000  # between configuration and start,
_BASELINE_PERIODS = 3  # but at least so many: an MTB3 takes its baseline for two, a conversion lasts up to 37 ms
WATCH_NS = 1_000_000_000  # plus WATCH_PERIODS
WATCH_PERIODS = 10


class BoardLink:
    """Commands to the boards of `foot`, and their answers. Generators wait by steps of the main loop."""

    def __init__(self, foot: Foot, feet: Sequence[Foot], assembler: CycleAssembler, gates: Mapping[str, Gate]) -> None:
        """`feet`: all feet of the rig, because they may share a bus; `gates`: by interface."""
        self.foot, self.assembler = foot, assembler
        self.boards: dict[int, Board] = {board.address: board for board in foot.insole.boards}
        self.triangles = {address: _triangles(foot, address) for address in self.boards}
        self._feet, self._gates = feet, gates
        self._slots = {
            address: np.flatnonzero(np.repeat([t.board == address for t in foot.layout.triangles], 2))
            for address in self.boards
        }

    @property
    def interfaces(self) -> list[str]:
        """The interfaces that have boards of this foot."""
        return list(dict.fromkeys(board.interface for board in self.boards.values()))

    def check_open(self) -> None:
        """Raise BusError if nothing may be sent to one of the interfaces."""
        for interface in self.interfaces:
            self._gate(interface).check_open()

    def loads(self) -> list[BusLoad]:
        """Return the configured load of each interface of this foot, including the other foot's boards on it."""
        loads = []
        for interface in self.interfaces:
            streams = [
                Stream(board.address, len(_triangles(foot, board.address)), board.period_ms)
                for foot in self._feet
                for board in foot.insole.boards
                if board.interface == interface
            ]
            loads.append(bus_load(interface, streams))
        return loads

    def arrivals(self, address: int) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """Return how often each half of the board's n triangles in the layout has arrived since the start, (2 · n,)."""
        return self.assembler.arrivals[self._slots[address]]

    def silence_ns(self, address: int, now_mono_ns: int) -> int | None:
        """Return the time since the last half of the board; None if the layout has no triangles of it."""
        slots = self._slots[address]
        return now_mono_ns - int(self.assembler.last_arrival_ns()[slots].max()) if len(slots) else None

    def is_streaming(self, address: int, now_mono_ns: int) -> bool:
        """Return whether a half of the board has arrived within the time after which data are stale."""
        silence_ns = self.silence_ns(address, now_mono_ns)
        return silence_ns is not None and silence_ns <= self.foot.stale_after_ns

    def send(self, address: int, command: Command) -> None:
        """Send one command to a board."""
        self._gate(self.boards[address].interface).send(command.can_id, command.payload)

    def discover(self) -> None:
        """Broadcast the discovery command on every interface of this foot."""
        question = commands.discovery()
        for interface in self.interfaces:
            self._gate(interface).send(question.can_id, question.payload)

    def send_all(self, step: Step, by_board: Mapping[int, Iterable[Command]]) -> Generator[None, Step, Step]:
        """Send each board its commands in order, one command per board in turn, PACE_NS apart."""
        for turn in zip_longest(*([(address, command) for command in queue] for address, queue in by_board.items())):
            for addressed in turn:
                if addressed is not None:
                    self.send(*addressed)
                    step = yield from pause(step, PACE_NS)
        return step

    def apply(self, step: Step, addresses: Collection[int]) -> Generator[None, Step, Step]:
        """Send the configured settings to the boards and start them; each takes a new baseline."""
        settings = {a: commands.configuration(self.boards[a], self.triangles[a]) for a in addresses}
        step = yield from self.send_all(step, {address: everything for address, (everything, _) in settings.items()})
        step = yield from pause(step, AGAIN_NS)
        step = yield from self.send_all(step, {address: again for address, (_, again) in settings.items()})
        slowest_ms = max(self.boards[address].period_ms for address in addresses)
        step = yield from pause(step, max(_BASELINE_NS, _BASELINE_PERIODS * slowest_ms * 1_000_000))
        return (yield from self.send_all(step, {address: [commands.transmit(address, True)] for address in addresses}))

    def answers(
        self,
        step: Step,
        read: Callable[[int, bytes], tuple[int, T] | None],
        expected: Collection[int] | None = None,
        wait_ns: int = ANSWER_NS,
    ) -> Generator[None, Step, tuple[Step, dict[int, T]]]:
        """Return what `read` decodes, by address, when all `expected` have answered or after `wait_ns`."""
        answers: dict[int, T] = {}
        until_ns = step.attended_ns + wait_ns
        while step.attended_ns < until_ns and (expected is None or not answers.keys() >= set(expected)):
            step = yield
            for can_id, payload in _short_frames(step.frames):
                answer = read(can_id, payload)
                if answer is not None:
                    answers[answer[0]] = answer[1]
        return step, answers

    def watch(
        self, step: Step, addresses: Collection[int], watch_ns: int = WATCH_NS, periods: int = WATCH_PERIODS
    ) -> Generator[None, Step, tuple[Step, dict[int, ObservedBoard]]]:
        """Return what the boards send in the next `watch_ns` plus `periods` periods of the slowest board."""
        slowest_ms = max(self.boards[address].period_ms for address in addresses)
        until_ns = step.attended_ns + watch_ns + periods * slowest_ms * 1_000_000
        watch = StreamWatch(addresses)
        while step.attended_ns < until_ns:
            step = yield
            watch.feed(step.frames)
        return step, watch.observed()

    def look(self, step: Step, without: Collection[int] = ()) -> Generator[None, Step, tuple[Step, FootLoad]]:
        """Return the load on the foot over the next LOOK_NS, by its boards except those in `without`."""
        record = LoadRecord(self.foot, without)
        until_ns = step.attended_ns + LOOK_NS
        while step.attended_ns < until_ns:
            step = yield
            record.add(step)
        return step, record.load()

    def _gate(self, interface: str) -> Gate:
        gate = self._gates.get(interface)
        if gate is None:
            raise BusError(f"nothing is sent to {interface}: this daemon does not read it as a bus")
        return gate


def _triangles(foot: Foot, address: int) -> list[int]:
    return [t.triangle for t in foot.layout.triangles if t.board == address]


def _short_frames(frames: FrameBatch) -> list[tuple[int, bytes]]:
    """Return (identifier, payload) of the frames that may be answers; they are few, so a Python loop is fast enough."""
    if not len(frames):
        return []
    cls = frames.can_id >> np.uint32(8)
    thermometer = (cls == CLASS_LEGACY_SKIN) & (frames.can_id & 0xF == TYPE_THERMOMETER) & (frames.dlc < 8)
    rows = np.flatnonzero(
        (frames.flags == 0) & (thermometer | (cls == commands.CLASS_COMMAND) | (cls == CLASS_MANAGEMENT))
    )
    return [(int(frames.can_id[row]), frames.data[row, : frames.dlc[row]].tobytes()) for row in rows]
