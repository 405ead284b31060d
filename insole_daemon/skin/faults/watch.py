"""Detection of all faults of one foot, cycle by cycle: the mask, the present faults, and their changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ...config import Board
from ..cycles import Cycles
from ..layout import Layout
from .boards import BoardStreams
from .places import Places
from .rest import Rest
from .rezero import Rezeroed
from .taxels import TaxelFaults, TaxelState
from .triangles import LooseTriangles
from .words import describe_fault

Kind = Literal[
    "board_silent", "board_reset", "board_address_clash", "board_rezeroed",
    "triangle_loose", "taxel_dead", "taxel_stuck", "taxel_saturated",
]  # fmt: skip
KINDS: tuple[Kind, ...] = get_args(Kind)
HEALED: dict[Kind, str] = {kind: f"{kind}_over" for kind in KINDS} | {"board_silent": "board_streaming"}

STALE_NS = np.uint64(1_000_000_000)  # older readings are not used for detection
LOOK_CYCLES = 2  # all faults but loose triangles are checked in every second cycle: converters are hardly faster

_TAXEL_KINDS: dict[int, Kind] = {
    TaxelState.DEAD: "taxel_dead",
    TaxelState.STUCK: "taxel_stuck",
    TaxelState.SATURATED: "taxel_saturated",
}
_Key = tuple[Kind, int, int | None, int | None]


@dataclass(frozen=True, slots=True)
class Fault:
    """A present fault."""

    kind: Kind
    board: int  # address
    triangle: int | None  # number on its board; None: all of the board
    taxel: int | None  # None: all of the triangle
    since_ns: int  # CLOCK_REALTIME


@dataclass(frozen=True, slots=True)
class Change:
    """The beginning or end of a fault; the first frame of a board is the end of its silence."""

    kind: Kind
    board: int
    triangle: int | None
    taxel: int | None
    began: bool  # False: it healed
    t_ns: int  # of the cycle, CLOCK_REALTIME
    text: str  # what happened and what to do, to a person

    @property
    def event(self) -> str:
        """The kind of the event."""
        return self.kind if self.began else HEALED[self.kind]


class FaultWatch:
    """Watches the counts of one foot.

    Pass every cycle, in order, first to `screen` and then to `update`; the result depends on the cycles alone.
    `masked` (n_triangles, 12) marks the taxels that may not enter pressure and wrench: all taxels of a loose triangle,
    of a silent board, of a re-zeroed board and of a board whose address is used twice, and dead or stuck taxels.
    Saturated taxels are invalid by their count; the readings of a restarted board are used.
    """

    def __init__(self, layout: Layout, boards: Mapping[int, Board]) -> None:
        """`boards` by address, those of the layout at least."""
        self._places = places = Places(layout, boards)
        n = len(layout)
        self.masked = np.zeros((n, 12), np.bool_)
        self._loose = LooseTriangles(places)
        self._streams = BoardStreams(places)
        self._rest = Rest(places)
        self._rezeroed = Rezeroed(places, self._rest)
        self._taxels = TaxelFaults(places, self._rest)
        self._arrivals = np.zeros(n, np.int64)
        self._counts = np.zeros((n, 12), np.uint8)
        self._there = np.zeros(n, np.bool_)  # both halves were received, not long ago
        self._fresh = np.zeros(n, np.bool_)  # halves came since the last look
        self._since = np.zeros(n, np.bool_)  # … since all of its board was fresh
        self._until_look = LOOK_CYCLES
        self._untold = False  # something was found by screening, or a person took a new zero
        self._active: dict[_Key, int] = {}
        self._heard = self._streams.seen.copy()
        self._believe()

    @property
    def faults(self) -> list[Fault]:
        """The present faults, the oldest first."""
        return [Fault(*key, since_ns) for key, since_ns in self._active.items()]

    def zeroed(self) -> None:
        """Handle a new zero of the unloaded foot: learn rest levels again and use re-zeroed boards again.

        The next cycle reports the faults that end with it.
        """
        self._rest.forget(np.ones_like(self._streams.seen))
        self._rezeroed.forget()
        self._believe()
        self._untold = True

    @property
    def loose(self) -> NDArray[np.bool_]:
        """(n_triangles,) which are loose, the same array for ever."""
        loose: NDArray[np.bool_] = self._loose.loose
        return loose

    @property
    def top_is_rail(self) -> NDArray[np.bool_]:
        """(n_triangles, 1) where 255 is no count of a triangle at rest."""
        return self._loose.top_is_rail

    def may_come_loose(self, counts: NDArray[np.uint8]) -> bool:
        """Return whether counts (n_triangles, 12) hint at a newly loose triangle; `screen` decides."""
        return self._loose.may_come_loose(counts)

    def screen(self, cycles: Cycles, at: int) -> None:
        """Mask the triangles that are loose in cycle `at`, before it is published."""
        if cycles.repeated[at]:
            return
        counts, arrivals = cycles.counts[at], cycles.arrivals[at]
        self._until_look -= 1
        odd = self._loose.must_update(counts)
        if odd or not self._until_look:
            received = cycles.age_ns[at].view(np.uint64) < STALE_NS  # never received is −1
            fresh = (arrivals != self._arrivals) & received
            self._arrivals = arrivals
            self._fresh |= fresh
            loose_changed = odd and self._loose.update(counts, fresh, int(cycles.t_mono_ns[at]))
            if loose_changed or np.count_nonzero(received != self._there):
                self._there = received
                self._believe()
            self._untold |= loose_changed

    def update(self, cycles: Cycles, at: int) -> list[Change]:
        """Process cycle `at`, which has been screened; return the faults that begin or end with it."""
        t_mono_ns = int(cycles.t_mono_ns[at])
        changed = self._streams.update(t_mono_ns, cycles.arrivals[at])
        if not (self._until_look or cycles.repeated[at]):
            self._until_look = LOOK_CYCLES
            changed |= self._look(cycles.counts[at], t_mono_ns)
        changed |= self._untold
        self._untold = False
        return self._changes(int(cycles.t_ns[at])) if changed else []

    def _look(self, counts: NDArray[np.uint8], t_mono_ns: int) -> bool:
        """Check the counts of a cycle for all other faults; return whether something changed."""
        places, rest, streams = self._places, self._rest, self._streams
        is_changed = (counts != self._counts).any(axis=1)
        fresh, self._counts = self._fresh, counts
        self._fresh = np.zeros(len(fresh), np.bool_)
        self._loose.listen(fresh, is_changed)
        counts_of_taxels = counts.reshape(-1)[places.taxel].astype(np.float32)
        rest.update(counts_of_taxels)
        # A cycle may close between the frames of a board: part of a new baseline is not a baseline.
        self._since |= fresh
        fresh_boards = places.any_of_board(self._since) & ~places.any_of_board(self._there & ~self._since)
        self._since &= ~fresh_boards[places.board_of_triangle]
        was_rezeroed = self._rezeroed.rezeroed.copy()
        changed = self._rezeroed.update(streams, fresh_boards, t_mono_ns)
        # After a pause a board may have a new baseline, by one noisy reading.
        new_baseline = streams.paused | (was_rezeroed & ~self._rezeroed.rezeroed)
        if np.count_nonzero(new_baseline):
            rest.forget(new_baseline)
            streams.paused[:] = False
        # A board whose baseline is in doubt is not used for learning, nor for judging other taxels.
        held = self._rezeroed.rezeroed | self._rezeroed.suspect | streams.crowded | streams.reset
        if not np.count_nonzero(held) and rest.unloaded():
            rest.learn(self._believed[places.triangle], fresh_boards)
        live = (self._believed & is_changed & ~held[places.board_of_triangle])[places.triangle]
        return self._taxels.update(counts_of_taxels, live, t_mono_ns) or changed

    def _believe(self) -> None:
        """Decide which triangles and taxels are used to judge others."""
        of_triangle = self._places.board_of_triangle
        wrong_board = self._streams.silent | self._streams.clash
        self._believed = self._there & ~self._loose.loose & ~wrong_board[of_triangle]
        well = self._taxels.state == TaxelState.OK
        self._rest.use(self._believed[self._places.triangle] & well)
        # A silent board becomes stale anyway, but its event states that it is left out, so it is masked from then on.
        self.masked[:] = (self._loose.loose | (wrong_board | self._rezeroed.rezeroed)[of_triangle])[:, None]
        out = (self._taxels.state == TaxelState.DEAD) | (self._taxels.state == TaxelState.STUCK)
        self.masked.reshape(-1)[self._places.taxel[out]] = True

    def _changes(self, t_ns: int) -> list[Change]:
        self._believe()
        present = self._present()
        changes = [self._change(key, False, t_ns) for key in [*self._active] if key not in present]
        for board in np.flatnonzero(self._streams.seen & ~self._heard).tolist():
            if all(change.board != self._places.addresses[board] for change in changes):
                changes.append(self._change(("board_silent", self._places.addresses[board], None, None), False, t_ns))
        self._heard = self._streams.seen.copy()
        return changes + [self._change(key, True, t_ns) for key in present if key not in self._active]

    def _present(self) -> list[_Key]:
        """Return the present faults, boards first."""
        streams, triangles = self._streams, self._places.layout.triangles
        of_boards: tuple[tuple[Kind, NDArray[np.bool_]], ...] = (
            ("board_silent", streams.silent),
            ("board_reset", streams.reset),
            ("board_address_clash", streams.clash),
            ("board_rezeroed", self._rezeroed.rezeroed),
        )
        keys: list[_Key] = [
            (kind, self._places.addresses[board], None, None)
            for kind, has_fault in of_boards
            for board in np.flatnonzero(has_fault).tolist()
        ]
        for row in np.flatnonzero(self._loose.loose).tolist():
            keys.append(("triangle_loose", triangles[row].board, triangles[row].triangle, None))
        for place in np.flatnonzero(self._taxels.state).tolist():
            row, taxel = divmod(int(self._places.taxel[place]), 12)
            kind = _TAXEL_KINDS[int(self._taxels.state[place])]
            keys.append((kind, triangles[row].board, triangles[row].triangle, taxel))
        return keys

    def _change(self, key: _Key, began: bool, t_ns: int) -> Change:
        if began:
            self._active[key] = t_ns
            lasted_s = None
        else:
            since_ns = self._active.pop(key, None)
            lasted_s = None if since_ns is None else (t_ns - since_ns) * 1e-9
        return Change(*key, began, t_ns, describe_fault(self._places.layout, *key, began, lasted_s))
