"""What a loop that cannot keep up leaves out, so that what it publishes does not get older and older."""

from __future__ import annotations

from collections.abc import Iterable

from ..skin.cycles import Cycles

BEHIND_NS = 40_000_000  # so old is a cycle only where others waited before it
PATIENCE_NS = 250_000_000


class Backlog:
    """Whether cycles come faster than they can be published.

    A pause is made up for: who was stopped publishes all that has waited. Only where that takes longer than PATIENCE_NS
    is there no making up, and older cycles give way to the newest until the loop is on time again.
    """

    def __init__(self) -> None:
        self._behind_since_ns: int | None = None

    def newest_only(self, closed: Iterable[Cycles], now_mono_ns: int) -> bool:
        """Whether all but the newest cycle of a foot are to be left out, now that these have closed."""
        oldest_ns = min((int(cycles.t_mono_ns[0]) for cycles in closed), default=None)
        if oldest_ns is None or now_mono_ns - oldest_ns <= BEHIND_NS:
            self._behind_since_ns = None
            return False
        if self._behind_since_ns is None:
            self._behind_since_ns = now_mono_ns
        return now_mono_ns - self._behind_since_ns > PATIENCE_NS
