"""The fault watch on several cycles at a time.

The first cycle after a sleep takes four times as long as the next ones, whose code and data are then in the caches. So
cycles are kept for GATHER_NS and checked together when the loop has time; those of all feet are checked with the first
that are due. Only a triangle that may just have come loose is checked at once, because it must not enter the
pressure of its cycle.
"""

from __future__ import annotations

from ..cycles import ClosedCycle, Cycles, rows_of
from .watch import Change, Fault, FaultWatch

GATHER_NS = 170_000_000  # from the first cycle to the last: ten of them at 50 Hz, every single one below 6 Hz
_MOST_GATHERED = 64  # if nobody asks for changes


class DeferredFaultWatch:
    """A FaultWatch that accepts every cycle at once and processes it later, with the same results.

    It reports and masks faults at most GATHER_NS later, and loose triangles at once.
    """

    def __init__(self, watch: FaultWatch) -> None:
        self._watch = watch
        self._gathered: list[tuple[ClosedCycle, bool]] = []  # and whether it was screened already
        self.is_due = False  # whether `changes` has something to tell or works off what was taken in
        self._changes: list[Change] = []
        self.masked = watch.masked  # (n_triangles, 12) as of FaultWatch, the same array for ever
        self.loose, self.top_is_rail = watch.loose, watch.top_is_rail  # (n_triangles,) and (n_triangles, 1), the same

    @property
    def faults(self) -> list[Fault]:
        """The present faults, the oldest first."""
        return self._watch.faults

    def take(self, cycles: Cycles, at: int) -> None:
        """Add cycle `at` before it is published; after the call every triangle that is loose in it is masked."""
        may_come_loose = not cycles.repeated[at] and self._watch.may_come_loose(cycles.counts[at])
        self.gather(ClosedCycle.of(cycles, at), may_come_loose)

    def gather(self, cycle: ClosedCycle, may_come_loose: bool) -> None:
        """The same of one cycle, of which it is known whether `may_come_loose` of its counts is true."""
        if may_come_loose:
            self._work_off()
            self._watch.screen(cycle.cycles, 0)
        gathered = self._gathered
        gathered.append((cycle, may_come_loose))
        if may_come_loose or cycle.t_mono_ns - gathered[0][0].t_mono_ns >= GATHER_NS:
            self.is_due = True
        if len(gathered) >= _MOST_GATHERED:
            self._work_off()

    def changes(self, early: bool = False) -> list[Change]:
        """Return the faults that began or ended since the last call; process cycles if they are due or if `early`."""
        if early or self.is_due:
            self._work_off()
        changes, self._changes, self.is_due = self._changes, [], False
        return changes

    def zeroed(self) -> None:
        """Do the same as `FaultWatch.zeroed`."""
        self._work_off()
        self._watch.zeroed()

    def _work_off(self) -> None:
        gathered, self._gathered = self._gathered, []
        rows = rows_of([cycle for cycle, _ in gathered])
        for (cycles, at), (_, screened) in zip(rows, gathered, strict=True):
            if not screened:
                self._watch.screen(cycles, at)
            self._changes += self._watch.update(cycles, at)
        self.is_due = bool(self._changes)
