"""The fault watch on several cycles at a time.

The first cycle after a sleep takes four times as long as the next ones, whose code and data are then in the caches. So
cycles are kept for GATHER_NS and checked together after they are published; those of all feet are checked as soon as
one foot's are due. Only a triangle that may just have come loose is checked at once, because it must not enter the
pressure of its cycle.
"""

from __future__ import annotations

from ..cycles import Cycles
from .watch import Change, Fault, FaultWatch

GATHER_NS = 70_000_000  # from the first cycle to the last: five of them at 50 Hz, every single one below 14 Hz
_MOST_GATHERED = 64  # if nobody asks for changes


class DeferredFaultWatch:
    """A FaultWatch that accepts every cycle at once and processes it later, with the same results.

    It reports and masks faults at most GATHER_NS later, and loose triangles at once.
    """

    def __init__(self, watch: FaultWatch) -> None:
        self._watch = watch
        self._gathered: list[tuple[Cycles, int, bool]] = []  # cycles, row, whether it was screened already
        self._urgent = False
        self._changes: list[Change] = []
        self.masked = watch.masked  # (n_triangles, 12) as of FaultWatch, the same array for ever

    @property
    def faults(self) -> list[Fault]:
        """The present faults, the oldest first."""
        return self._watch.faults

    def take(self, cycles: Cycles, at: int) -> None:
        """Add cycle `at` before it is published; after the call every triangle that is loose in it is masked."""
        urgent = not cycles.repeated[at] and self._watch.may_come_loose(cycles.counts[at])
        if urgent:
            self._work_off()
            self._watch.screen(cycles, at)
            self._urgent = True
        self._gathered.append((cycles, at, urgent))
        if len(self._gathered) >= _MOST_GATHERED:
            self._work_off()

    @property
    def is_due(self) -> bool:
        """Whether `changes` would return something or process cycles."""
        return bool(self._changes) or (bool(self._gathered) and (self._urgent or self._span_ns() >= GATHER_NS))

    def changes(self, early: bool = False) -> list[Change]:
        """Return the faults that began or ended since the last call; process cycles if they are due or if `early`."""
        if early or self.is_due:
            self._work_off()
        changes, self._changes = self._changes, []
        return changes

    def zeroed(self) -> None:
        """Do the same as `FaultWatch.zeroed`."""
        self._work_off()
        self._watch.zeroed()

    def _span_ns(self) -> int:
        (first, first_at, _), (last, last_at, _) = self._gathered[0], self._gathered[-1]
        return int(last.t_mono_ns[last_at]) - int(first.t_mono_ns[first_at])

    def _work_off(self) -> None:
        gathered, self._gathered, self._urgent = self._gathered, [], False
        for cycles, at, screened in gathered:
            if not screened:
                self._watch.screen(cycles, at)
            self._changes += self._watch.update(cycles, at)
