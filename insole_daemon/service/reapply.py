"""Configure boards again that were reset.

A board that was reset has lost settings and baseline, and is silent until it is commanded (robotology/icub-firmware,
theSkin's deferred initialisation). A board that falls silent is therefore asked for its version repeatedly, which sets
nothing. If it answers and still sends nothing, it was reset. If it sends with other settings than it was given, it was
reset and started by another host.

The board is configured again once the foot bears no load, by the foot's other boards, and an event reports it. The load
is recorded while a board is silent, so that the board is back at its full rate within a second of its answer.
"""

from __future__ import annotations

from collections.abc import Collection, Generator

import numpy as np

from ..errors import InsoleError
from ..skin import commands
from ..skin.confirmation import ObservedBoard
from .boards import BoardOperations
from .load import FootLoad, LoadRecord
from .operations import Operation, Step, pause

_EVERY_NS = 1_000_000_000
_RATE_TOLERANCE = 0.25  # over a second, before the stream is examined
_SILENT_PERIODS = 10
_ANSWER_NS = 50_000_000  # before the board is asked again: an answer takes some 10 ms
_QUIET_PERIODS = 3  # without a frame after the answer: an interface that was down delivers answer and stream together
_REFUSED_NS = 250_000_000  # between attempts on a full queue, each of which costs the loop 5 ms
MOST_ATTEMPTS = 3  # to configure a board whose stream does not confirm it

_Counts = np.ndarray[tuple[int], np.dtype[np.int64]]


def keep_configured(boards: BoardOperations) -> Operation:
    """Run as long as the daemon; boards that this daemon has not configured, or has stopped, are left alone."""
    keeper = _Keeper(boards)
    step = yield
    while True:
        try:
            step = yield from keeper.turn(step)
        except InsoleError:  # the interface takes no frames now; the source reports that
            step = yield from pause(step, _REFUSED_NS)


class _Keeper:
    """The state of the boards between two checks."""

    def __init__(self, boards: BoardOperations) -> None:
        self._boards, self._link = boards, boards.link
        self._load = LoadRecord(boards.link.foot)
        self._counted: tuple[int, dict[int, _Counts]] | None = None  # time and arrivals at the last count
        self._attempts: dict[int, int] = {}  # without confirmation, by address
        self._told_waiting: set[int] = set()

    def turn(self, step: Step) -> Generator[None, Step, Step]:
        """Check the boards once, and configure again those that were reset."""
        boards = self._boards
        if not boards.configured or boards.stopped or boards.occupied is not None:
            self._counted = None  # the counts span a time in which boards may have been silent
            return (yield)
        self._load.add(step)
        silent = {address for address in boards.configured if self._silent(address, step.now_mono_ns)}
        if silent:
            step, reset = yield from self._reset(step, silent)
            if reset and boards.occupied is None and not boards.stopped:
                step = yield from self._again(step, reset, self._load.load())
        odd = self._odd(step.now_mono_ns) - silent
        if odd:
            step = yield from self._look_at(step, odd)
        return (yield)

    def _silent(self, address: int, now_ns: int) -> bool:
        silence_ns, period_ms = self._link.silence_ns(address, now_ns), self._link.boards[address].period_ms
        return silence_ns is not None and silence_ns > _SILENT_PERIODS * period_ms * 1_000_000

    def _odd(self, now_ns: int) -> set[int]:
        """Return, once a second, the boards whose halves arrive at another rate than configured."""
        link = self._link
        if self._counted is not None and now_ns - self._counted[0] < _EVERY_NS:
            return set()
        before, self._counted = self._counted, (now_ns, {a: link.arrivals(a).copy() for a in link.boards})
        if before is None:
            return set()
        odd = set()
        for address in self._boards.configured:
            rates_hz = (self._counted[1][address] - before[1][address]) / ((now_ns - before[0]) * 1e-9)
            expected_hz = 1000 / link.boards[address].period_ms
            if (abs(rates_hz - expected_hz) > _RATE_TOLERANCE * expected_hz + 1).any():
                odd.add(address)
        if not odd:
            self._attempts.clear()
            self._told_waiting.clear()
        return odd

    def _reset(self, step: Step, silent: set[int]) -> Generator[None, Step, tuple[Step, set[int]]]:
        """Return the boards among `silent` that answer and still send nothing."""
        link = self._link
        for address in silent:
            link.send(address, commands.version_query(address))
        step, answers = yield from link.answers(step, commands.read_version, silent, _ANSWER_NS)
        alive = answers.keys() & silent
        if not alive:
            return step, set()
        step, seen = yield from link.watch(step, alive, 0, _QUIET_PERIODS)
        return step, {address for address in alive if not seen[address].triangles}

    def _look_at(self, step: Step, odd: Collection[int]) -> Generator[None, Step, Step]:
        """Configure the boards in `odd` again whose streams show other settings than configured."""
        boards, link = self._boards, self._link
        boards.occupied = "boards that seem to have been reset are looked at"
        try:
            step, seen = yield from link.watch(step, odd)
            forgot = {a for a in odd if seen[a].triangles and seen[a].differences(link.boards[a], link.triangles[a])}
            if forgot:
                step, load = yield from link.look(step, without=forgot)
                step = yield from self._again(step, forgot, load)
        finally:
            boards.occupied = None
        return step

    def _again(self, step: Step, forgot: set[int], load: FootLoad) -> Generator[None, Step, Step]:
        """Configure the boards again, unless the foot is loaded; give up after MOST_ATTEMPTS without confirmation."""
        boards = self._boards
        if load.loaded:
            if not forgot <= self._told_waiting:
                self._told_waiting |= forgot
                boards.tell(
                    "boards_waiting",
                    f"board {_words(forgot)} lost its configuration and is configured again once the "
                    f"{self._link.foot.name} foot bears no load for 1.5 s: now {load.words}",
                    forgot,
                )
            return step
        self._told_waiting -= forgot
        boards.occupied = "boards that were reset are configured again"
        try:
            boards.tell(
                "boards_reset",
                f"board {_words(forgot)} lost its configuration: it was reset, and is told again",
                forgot,
            )
            step, seen = yield from boards.apply(step, forgot, load.words)
        finally:
            boards.occupied = None
            self._counted = None  # the counts span the old and the new settings
        for address in sorted(forgot):
            self._tell_verdict(address, seen[address])
        return step

    def _tell_verdict(self, address: int, seen: ObservedBoard) -> None:
        boards, board = self._boards, self._link.boards[address]
        wrong = seen.differences(board, self._link.triangles[address]) + seen.rest_difference(board)
        if not wrong:
            self._attempts.pop(address, None)
            boards.tell("boards_configured", f"board {address} configured again, its stream confirms it", [address])
            return
        self._attempts[address] = self._attempts.get(address, 0) + 1
        text = f"board {address} configured again, not confirmed: {'; '.join(wrong)}"
        if self._attempts[address] >= MOST_ATTEMPTS:
            boards.configured.discard(address)
            text += f"; given up after {MOST_ATTEMPTS} times, 'insole boards configure' tries again"
        boards.tell("boards_not_confirmed", text, [address])


def _words(addresses: Collection[int]) -> str:
    return ", ".join(map(str, sorted(addresses)))
