"""Boards that forgot what this daemon had told them are told again.

A board that was reset has lost settings and baseline, and is silent until it is commanded (robotology/icub-firmware,
theSkin's deferred initialisation). So one that fell silent is asked for its version, which sets nothing: when it
answers it is alive and was reset. One that sends again, but not what it was told, was reset and started by another.

It is configured again while the foot bears no load, as far as its other boards can tell, and an event says so.
"""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from ..errors import InsoleError
from ..skin import commands
from .board_link import BoardLink, Load
from .boards import BoardOperations
from .operations import Operation, Step

_EVERY_NS = 1_000_000_000
_RATE_TOLERANCE = 0.25  # over a second, before the stream is looked at closely
MOST_ATTEMPTS = 3  # that the stream does not confirm


def keep_configured(boards: BoardOperations) -> Operation:
    """Runs as long as the daemon; does nothing to boards that this daemon has not configured, or has stopped."""
    link = boards.link
    attempts: dict[int, int] = {}  # by address, that were not confirmed
    told_waiting: set[int] = set()
    step = yield
    while True:
        arrivals, since_ns = {a: link.arrivals(a).copy() for a in link.boards}, step.now_mono_ns
        was_occupied = False
        while step.now_mono_ns - since_ns < _EVERY_NS:
            step = yield
            was_occupied |= boards.occupied is not None
        if was_occupied or boards.stopped or not boards.configured:
            continue  # what was counted says nothing
        elapsed_s = (step.now_mono_ns - since_ns) * 1e-9
        suspects = {
            address
            for address in boards.configured
            if _odd(link, address, (link.arrivals(address) - arrivals[address]) / elapsed_s)
        }
        if not suspects:
            attempts.clear()
            told_waiting.clear()
            continue
        boards.occupied = "boards that seem to have been reset are looked at and configured again"
        try:
            step, forgot = yield from _forgot(step, link, suspects)
            if forgot:
                step, load = yield from link.look(step, without=forgot)
                if load.loaded:
                    if not forgot <= told_waiting:
                        told_waiting |= forgot
                        _tell_waiting(boards, forgot, load)
                else:
                    told_waiting -= forgot
                    step = yield from _apply(step, boards, forgot, load, attempts)
        except InsoleError:
            pass  # the interface takes nothing now: the next round tries again, and the source reports it
        finally:
            boards.occupied = None


def _odd(link: BoardLink, address: int, rates_hz: np.ndarray[tuple[int], np.dtype[np.float64]]) -> bool:
    """Whether the halves of a board came at other rates than it was told."""
    expected_hz = 1000 / link.boards[address].period_ms
    return len(rates_hz) > 0 and bool((abs(rates_hz - expected_hz) > _RATE_TOLERANCE * expected_hz + 1).any())


def _forgot(step: Step, link: BoardLink, suspects: set[int]) -> Generator[None, Step, tuple[Step, set[int]]]:
    """The boards among `suspects` that are there and do not do what they were told."""
    step, seen = yield from link.watch(step, suspects)
    silent = {address for address in suspects if not seen[address].triangles}
    other = {a for a in suspects - silent if seen[a].differences(link.boards[a], link.triangles[a])}
    if silent:
        for address in silent:
            link.send(address, commands.version_query(address))
        step, alive = yield from link.answers(step, commands.read_version, silent)
        other |= silent & alive.keys()
    return step, other


def _apply(
    step: Step, boards: BoardOperations, forgot: set[int], load: Load, attempts: dict[int, int]
) -> Generator[None, Step, Step]:
    """Configure them again; after some attempts without effect, no more."""
    words = ", ".join(map(str, sorted(forgot)))
    boards.tell("boards_reset", f"board {words} lost its configuration: it was reset, and is told again", forgot)
    step, seen = yield from boards.apply(step, forgot, load.words)
    for address in sorted(forgot):
        board = boards.link.boards[address]
        wrong = seen[address].differences(board, boards.link.triangles[address]) + seen[address].rest_difference(board)
        if not wrong:
            attempts.pop(address, None)
            boards.tell("boards_configured", f"board {address} configured again, its stream confirms it", [address])
            continue
        attempts[address] = attempts.get(address, 0) + 1
        text = f"board {address} configured again, not confirmed: {'; '.join(wrong)}"
        if attempts[address] >= MOST_ATTEMPTS:
            boards.configured.discard(address)
            text += f"; given up after {MOST_ATTEMPTS} times, 'insole boards configure' tries again"
        boards.tell("boards_not_confirmed", text, [address])
    return step


def _tell_waiting(boards: BoardOperations, forgot: set[int], load: Load) -> None:
    boards.tell(
        "boards_waiting",
        f"board {', '.join(map(str, sorted(forgot)))} lost its configuration and is configured again once the "
        f"{boards.link.foot.name} foot bears no load for 1.5 s: now {load.words}",
        forgot,
    )
