"""The boards of one foot as the loop reaches them: commands out through the gates, answers and loads back in."""

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
from ..skin.bus_load import BusLoad, Stream, bus_load
from ..skin.commands import Command
from ..skin.confirmation import ObservedBoard, StreamWatch
from ..skin.cycles import CycleAssembler
from ..skin.identifiers import CLASS_LEGACY_SKIN, CLASS_MANAGEMENT, TYPE_THERMOMETER
from .foot import Foot
from .load import LOOK_NS, FootLoad, LoadRecord
from .operations import Step, pause

T = TypeVar("T")

PACE_NS = 10_000_000  # between frames to the boards: what the boards' own host leaves them, and no queue fills
ANSWER_NS = 500_000_000
AGAIN_NS = 100_000_000  # until the triangle configuration is sent the second time, see skin.commands
_BASELINE_NS = 250_000_000  # before the start, and
_BASELINE_PERIODS = 3  # at least: an MTB3 takes its baseline for two, a converter takes 37 ms for a new value
WATCH_NS = 1_000_000_000  # and some periods more
WATCH_PERIODS = 10


class BoardLink:
    """Commands to the boards of `foot` and what comes back; all waiting is in steps of the loop."""

    def __init__(self, foot: Foot, feet: Sequence[Foot], assembler: CycleAssembler, gates: Mapping[str, Gate]) -> None:
        """`feet`: all of the rig, for what they share a bus with; `gates` by channel."""
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
        """Those with boards of this foot."""
        return list(dict.fromkeys(board.interface for board in self.boards.values()))

    def check_open(self) -> None:
        """Raise BusError where nothing may be sent."""
        for interface in self.interfaces:
            self._gate(interface).check_open()

    def loads(self) -> list[BusLoad]:
        """What the interfaces of this foot are to carry by the configuration, the other foot's boards included."""
        found = []
        for interface in self.interfaces:
            streams = [
                Stream(board.address, len(_triangles(foot, board.address)), board.period_ms)
                for foot in self._feet
                for board in foot.insole.boards
                if board.interface == interface
            ]
            found.append(bus_load(interface, streams))
        return found

    def arrivals(self, address: int) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """(2 · n,) how often each half of its triangles in the layout has arrived since the start."""
        return self.assembler.arrivals[self._slots[address]]

    def silence_ns(self, address: int, now_mono_ns: int) -> int | None:
        """How long nothing of the board has arrived; None where it has no triangles in the layout."""
        slots = self._slots[address]
        return now_mono_ns - int(self.assembler.last_arrival_ns()[slots].max()) if len(slots) else None

    def streaming(self, address: int, now_mono_ns: int) -> bool:
        """Whether anything of the board has arrived lately."""
        silence_ns = self.silence_ns(address, now_mono_ns)
        return silence_ns is not None and silence_ns <= self.foot.stale_after_ns

    def send(self, address: int, command: Command) -> None:
        """Send to the interface that the board is on."""
        self._gate(self.boards[address].interface).send(command.can_id, command.payload)

    def discover(self) -> None:
        """Ask everyone on every interface of this foot."""
        question = commands.discovery()
        for interface in self.interfaces:
            self._gate(interface).send(question.can_id, question.payload)

    def send_all(self, step: Step, by_board: Mapping[int, Iterable[Command]]) -> Generator[None, Step, Step]:
        """Send every board its commands in order, the boards in turn, at the boards' pace."""
        for turn in zip_longest(*([(address, command) for command in told] for address, told in by_board.items())):
            for told in turn:
                if told is not None:
                    self.send(*told)
                    step = yield from pause(step, PACE_NS)
        return step

    def apply(self, step: Step, addresses: Collection[int]) -> Generator[None, Step, Step]:
        """Configure the boards as the configuration says, and start them; takes their baselines anew."""
        told = {address: commands.configuration(self.boards[address], self.triangles[address]) for address in addresses}
        step = yield from self.send_all(step, {address: everything for address, (everything, _) in told.items()})
        step = yield from pause(step, AGAIN_NS)
        step = yield from self.send_all(step, {address: again for address, (_, again) in told.items()})
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
        """What `read` finds by address, once all `expected` have answered or `wait_ns` are over."""
        found: dict[int, T] = {}
        until_ns = step.attended_ns + wait_ns
        while step.attended_ns < until_ns and (expected is None or not found.keys() >= set(expected)):
            step = yield
            for can_id, payload in _short_frames(step.frames):
                answer = read(can_id, payload)
                if answer is not None:
                    found[answer[0]] = answer[1]
        return step, found

    def watch(
        self, step: Step, addresses: Collection[int], watch_ns: int = WATCH_NS, periods: int = WATCH_PERIODS
    ) -> Generator[None, Step, tuple[Step, dict[int, ObservedBoard]]]:
        """What the boards send in the next `watch_ns` and `periods` of the slowest."""
        slowest_ms = max(self.boards[address].period_ms for address in addresses)
        until_ns = step.attended_ns + watch_ns + periods * slowest_ms * 1_000_000
        watch = StreamWatch(addresses)
        while step.attended_ns < until_ns:
            step = yield
            watch.feed(step.frames)
        return step, watch.observed()

    def look(self, step: Step, without: Collection[int] = ()) -> Generator[None, Step, tuple[Step, FootLoad]]:
        """What presses on the foot, read from its boards, those in `without` left out."""
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
    """(identifier, payload) of the frames that may be answers: few, so each may cost some Python."""
    if not len(frames):
        return []
    cls = frames.can_id >> np.uint32(8)
    thermometer = (cls == CLASS_LEGACY_SKIN) & (frames.can_id & 0xF == TYPE_THERMOMETER) & (frames.dlc < 8)
    rows = np.flatnonzero(
        (frames.flags == 0) & (thermometer | (cls == commands.CLASS_COMMAND) | (cls == CLASS_MANAGEMENT))
    )
    return [(int(frames.can_id[row]), frames.data[row, : frames.dlc[row]].tobytes()) for row in rows]
