"""The fault watch over several cycles at a time.

Its code costs four times as much for the first cycle after a sleep as for the next ones, whose code and data are in
the caches by then. So cycles are kept for GATHER_NS and watched together, once they are published, and those of all
feet as soon as one foot's are due. Only a triangle that may just have come loose cannot wait: it must not enter the
pressure of this cycle.
"""

from __future__ import annotations

from ..cycles import Cycles
from .watch import Change, Fault, FaultWatch

GATHER_NS = 70_000_000  # from the first cycle to the last: five of them at 50 Hz, every single one below 14 Hz
_MOST_GATHERED = 64  # where nobody asks for changes


class DeferredFaultWatch:
    """A FaultWatch that is given every cycle at once and works it off later, with the same results.

    What it finds is told, and masked, by GATHER_NS later at the most; loose triangles are masked at once.
    """

    def __init__(self, watch: FaultWatch) -> None:
        self._watch = watch
        self._gathered: list[tuple[Cycles, int, bool]] = []  # cycles, row, whether it was screened already
        self._urgent = False
        self._changes: list[Change] = []
        self.masked = watch.masked  # (n_triangles, 12) as of FaultWatch, the same array for ever

    @property
    def faults(self) -> list[Fault]:
        """What is wrong now, the longest first."""
        return self._watch.faults

    def take(self, cycles: Cycles, at: int) -> None:
        """Take in cycle `at`, before anybody reads it: after the call no triangle that is loose in it is unmasked."""
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
        """Whether `changes` has something to tell or works off what was taken in."""
        return bool(self._changes) or (bool(self._gathered) and (self._urgent or self._span_ns() >= GATHER_NS))

    def changes(self, early: bool = False) -> list[Change]:
        """What began or healed since the last call, in the cycles worked off: once they are due, or now if `early`."""
        if early or self.is_due:
            self._work_off()
        changes, self._changes = self._changes, []
        return changes

    def zeroed(self) -> None:
        """See FaultWatch."""
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
