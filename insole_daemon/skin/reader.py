"""The reader that turns frames of all buses into the cycles of every foot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..bus.frames import FrameBatch, ReceivedFrames
from ..compiled import kernel
from .assembler import CycleAssembler
from .cycles import ClosedCycle, Cycles
from .layout import Layout
from .streams import Streams

JITTER_NS = 2_000_000  # largest usual delay of a cycle after its promised time


class Expected(NamedTuple):
    """The next events that a SkinReader waits for."""

    due_ns: int | None  # when the next cycle is closed by time; None before the first frame
    outstanding: int | None  # halves until a cycle of some foot is complete; None: no foot waits for any
    promised_ns: int | None  # when that will be; None where none is waited for, or one has no rhythm


class SkinReader:
    """Sorts frames by foot and closes the cycles of each; `layouts`, one a foot, give the order of all results."""

    def __init__(self, layouts: Sequence[Layout], period_ns: int, slack_ns: int) -> None:
        self._period_ns = period_ns
        self.streams = Streams(layouts)
        first_slots = np.cumsum([0, *(2 * len(layout) for layout in layouts)]).tolist()
        self.assemblers = [
            CycleAssembler(layout.identities[:, 0], period_ns, slack_ns, first)
            for layout, first in zip(layouts, first_slots[:-1], strict=True)
        ]
        self._may_hold = False  # whether an assembler may hold frames that it has not looked at
        self._sorter = None
        if kernel is not None:
            self._sorter = self.streams.sorter([assembler.compiled for assembler in self.assemblers])

    def feed(self, batch: FrameBatch) -> list[list[Cycles]]:
        """Add frames; return the cycles that they close, for every foot."""
        if not len(batch):
            return [[] for _ in self.assemblers]
        slots = self.streams.slots(batch)
        self._may_hold = True
        return [assembler.feed(slots, batch.data, batch.t_ns, batch.t_mono_ns) for assembler in self.assemblers]

    def closed_cycles(self, batch: FrameBatch) -> list[list[ClosedCycle]]:
        """As `feed`, each cycle by itself: for the live path, where the kernel does it in one call."""
        if self._sorter is None or not isinstance(batch, ReceivedFrames):
            if not len(batch):
                return [[] for _ in self.assemblers]
            frames = self.streams.slots(batch), batch.data, batch.t_ns, batch.t_mono_ns
            return [assembler.closed_cycles(*frames) for assembler in self.assemblers]
        if self._may_hold:
            for assembler in self.assemblers:
                assembler.settle()
            self._may_hold = False
        n_refused, closed_by_foot = kernel.take(self._sorter, batch.block)
        if n_refused:
            self.streams.count_refused()
        return [[ClosedCycle(*cycle) for cycle in closed] for closed in closed_by_foot]

    def cycles_closed_by_time(self, now_mono_ns: int) -> list[list[ClosedCycle]]:
        """As `advance`, each cycle by itself."""
        return [assembler.cycles_closed_by_time(now_mono_ns) for assembler in self.assemblers]

    def advance(self, now_mono_ns: int) -> list[list[Cycles]]:
        """Return the cycles that time alone closes, for every foot; every earlier frame must have been fed."""
        return [assembler.advance(now_mono_ns) for assembler in self.assemblers]

    def expected(self) -> Expected:
        """Return the next events of all feet."""
        if self._sorter is not None and not self._may_hold:
            return Expected(*kernel.expected(self._sorter))
        due_ns = outstanding = promised_ns = None
        in_rhythm = True
        for assembler in self.assemblers:
            if assembler.due_ns is not None and (due_ns is None or assembler.due_ns < due_ns):
                due_ns = assembler.due_ns
            n, promise_ns = assembler.outstanding, assembler.promised_ns
            if not n:
                continue
            if outstanding is None or n < outstanding:
                outstanding = n
            if promise_ns is None:
                in_rhythm = False
            elif promised_ns is None or promise_ns < promised_ns:
                promised_ns = promise_ns
        return Expected(due_ns, outstanding, promised_ns if in_rhythm else None)

    def best_poll_ns(self, from_ns: int) -> int:
        """Return the best time to poll within a period of `from_ns`: the newest cycles of all feet are then youngest.

        It is `from_ns` itself if no foot is waited for, or if one is not periodic.
        """
        complete_times_ns = [promise + JITTER_NS for promise in self._promises_ns()]
        poll_times_ns = [from_ns + (complete_ns - from_ns) % self._period_ns for complete_ns in complete_times_ns]
        return min(
            poll_times_ns,
            key=lambda poll_ns: sum((poll_ns - complete_ns) % self._period_ns for complete_ns in complete_times_ns),
            default=from_ns,
        )

    def _promises_ns(self) -> list[int]:
        """Return the promised times of the feet that are waited for; empty if one of them is not periodic."""
        waited_for = [assembler.promised_ns for assembler in self.assemblers if assembler.outstanding]
        promises = [promise for promise in waited_for if promise is not None]
        return promises if len(promises) == len(waited_for) else []
