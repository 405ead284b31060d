"""All faults of one foot, cycle by cycle: what is masked, what is wrong, and an event when that changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...config import Board
from ..cycles import Cycles
from ..layout import Layout
from .boards import BoardStreams
from .rest import Rest
from .rezero import Rezeroed
from .taxels import TaxelFaults, TaxelState
from .triangles import LooseTriangles
from .words import describe

Kind = Literal["loose", "dead", "stuck", "saturated", "rezeroed", "silent", "reset", "address_clash"]

_TAXEL_KINDS: dict[int, Kind] = {
    TaxelState.DEAD: "dead",
    TaxelState.STUCK: "stuck",
    TaxelState.SATURATED: "saturated",
}


class TriangleState(IntEnum):
    """What is wrong with a triangle."""

    OK = 0
    LOOSE = 1


class BoardState(IntEnum):
    """What is wrong with a board; of several, the highest."""

    OK = 0
    RESET = 1
    REZEROED = 2
    ADDRESS_CLASH = 3
    SILENT = 4


@dataclass(frozen=True, slots=True)
class FaultEvent:
    """A fault began, or healed."""

    kind: Kind
    board: int  # address
    triangle: int | None  # number on its board
    taxel: int | None
    began: bool  # False: it healed
    t_ns: int  # of the cycle, CLOCK_REALTIME
    text: str  # what happened and what to do, to a person


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault that is there."""

    kind: Kind
    board: int
    triangle: int | None
    taxel: int | None
    since_ns: int  # CLOCK_REALTIME


class FaultWatch:
    """Watches the counts of one foot.

    To be updated with every published cycle, in order. `masked` is what the caller takes out of `valid`: all
    taxels of a loose triangle, of a re-zeroed board and of one whose address is used twice, and the taxels that
    are dead, stuck or saturated. Silent boards are stale by themselves, and one that restarted is believed.
    """

    def __init__(self, layout: Layout, boards: Mapping[int, Board]) -> None:
        self._layout = layout
        n = len(layout)
        self.masked = np.zeros((n, 12), np.bool_)
        self.triangle_state = np.zeros(n, np.uint8)  # TriangleState
        self.taxel_state = np.zeros((n, 12), np.uint8)  # TaxelState; 0 on thermal pads
        self._rest = Rest(layout, boards)
        self.addresses = tuple(self._rest.addresses)
        self.board_state = np.zeros(len(self.addresses), np.uint8)  # BoardState, in the order of `addresses`
        self._loose = LooseTriangles(layout, boards)
        self._streams = BoardStreams(layout, boards)
        self._rezeroed = Rezeroed(
            self._rest, np.array([boards[a].period_ms * 1_000_000 for a in self.addresses], np.int64)
        )
        self._taxels = TaxelFaults(layout, self._rest)
        self._older_ns = np.zeros(n, np.int64)
        self._counts = np.zeros((n, 12), np.uint8)
        self._marks = np.zeros(n + 4 * len(self.addresses) + len(self._rest.pressure), np.uint8)
        self._active: dict[tuple[Kind, int, int | None, int | None], int] = {}

    @property
    def faults(self) -> list[Fault]:
        """What is wrong now, the longest first."""
        return [Fault(*key, since_ns) for key, since_ns in self._active.items()]

    def update(self, cycles: Cycles, at: int) -> list[FaultEvent]:
        """Take in cycle `at`; the faults that began or healed with it."""
        t_mono_ns = int(cycles.t_mono_ns[at])
        counts, age_ns = cycles.counts[at], cycles.age_ns[at]
        streams, rest = self._streams, self._rest
        streams.update(t_mono_ns, age_ns, cycles.arrived[at])
        if not cycles.repeated[at]:
            older_ns = cycles.triangle_t_ns[at]
            # Either half: while one is new and the other is not, the triangle is fresh already.
            changed = (counts != self._counts).any(axis=1)
            fresh = (older_ns != self._older_ns) | changed
            self._counts, self._older_ns = counts, older_ns
            never = age_ns < 0
            loose = self._loose.update(counts, fresh & ~never, changed, t_mono_ns)
            if never.any():
                loose &= ~never
            boards = rest.board_of_triangle
            believed = ~loose & ~never & ~(streams.silent | streams.clash)[boards]
            ok = believed[rest.triangle] & (self._taxels.state == TaxelState.OK)
            taken = counts.reshape(-1)[rest.pressure].astype(np.float32)
            rest.update(taken, ok)
            rezeroed = self._rezeroed.update(ok, streams, t_mono_ns)
            held = rezeroed | self._rezeroed.suspect | streams.crowded
            if not held.any() and rest.unloaded().all():
                rest.learn(ok, streams.fresh)
            sane = believed & ~held[boards]
            self._taxels.update(taken, sane[rest.triangle], (changed & fresh)[rest.triangle], t_mono_ns)
        return self._changes(int(cycles.t_ns[at]))

    def _changes(self, t_ns: int) -> list[FaultEvent]:
        streams, rest = self._streams, self._rest
        marks = np.concatenate(
            [
                streams.silent, streams.reset, streams.clash, self._rezeroed.rezeroed, self._loose.loose,
                self._taxels.state,
            ]
        ).astype(np.uint8)  # fmt: skip
        if np.array_equal(marks, self._marks):
            return []
        changed = np.flatnonzero(marks != self._marks)
        before, self._marks = self._marks, marks
        self.triangle_state[:] = self._loose.loose
        self.taxel_state.reshape(-1)[rest.pressure] = self._taxels.state
        board_state = np.zeros_like(self.board_state)
        for code, there in (
            (BoardState.RESET, streams.reset),
            (BoardState.REZEROED, self._rezeroed.rezeroed),
            (BoardState.ADDRESS_CLASH, streams.clash),
            (BoardState.SILENT, streams.silent),
        ):
            board_state[there] = code
        self.board_state[:] = board_state
        wrong_board = (self._rezeroed.rezeroed | streams.clash)[rest.board_of_triangle]
        self.masked[:] = (self.taxel_state != 0) | (self._loose.loose | wrong_board)[:, None]
        return [event for index in changed.tolist() for event in self._events(index, before, marks, t_ns)]

    def _events(self, index: int, before: NDArray[np.uint8], now: NDArray[np.uint8], t_ns: int) -> list[FaultEvent]:
        """Of one changed mark; a taxel may go from one fault to another."""
        n, n_boards = len(self._layout), len(self.addresses)
        old, new = int(before[index]), int(now[index])
        if index < 4 * n_boards:
            board_kinds: tuple[Kind, ...] = ("silent", "reset", "address_clash", "rezeroed")
            return [
                self._event(
                    board_kinds[index // n_boards], self.addresses[index % n_boards], None, None, bool(new), t_ns
                )
            ]
        index -= 4 * n_boards
        if index < n:
            triangle = self._layout.triangles[index]
            return [self._event("loose", triangle.board, triangle.triangle, None, bool(new), t_ns)]
        place = int(self._rest.pressure[index - n])
        triangle = self._layout.triangles[place // 12]
        return [
            self._event(_TAXEL_KINDS[state], triangle.board, triangle.triangle, place % 12, began, t_ns)
            for state, began in ((old, False), (new, True))
            if state
        ]

    def _event(
        self, kind: Kind, board: int, triangle: int | None, taxel: int | None, began: bool, t_ns: int
    ) -> FaultEvent:
        key = (kind, board, triangle, taxel)
        since_ns = t_ns
        if began:
            self._active[key] = t_ns
        else:
            since_ns = self._active.pop(key, t_ns)
        return FaultEvent(
            kind, board, triangle, taxel, began, t_ns,
            describe(self._layout, kind, board, triangle, taxel, began, (t_ns - since_ns) * 1e-9),
        )  # fmt: skip
