"""What a loop does that cannot keep up: it looks less often, and publishes only what is newest then.

Waking up costs more than what is done then, so a loop that looks half as often needs little more than half of the CPU;
and one that stays below what it is given is not stopped in the midst of a cycle, with data in hand that get older.
"""

from __future__ import annotations

from collections.abc import Callable

OLD_NS = 100_000_000  # at full rate: until cycles get so old, they had better be late than not be
OVERSLEPT_NS = 40_000_000  # beyond a pause: the loop was kept from looking
PATIENCE_NS = 300_000_000  # of being behind, what was on time in between taken off
PAUSES_NS = (0, 15_000_000, 30_000_000, 60_000_000, 120_000_000, 240_000_000)  # before each look: 50 to 4 Hz
TRIAL_NS = 1_000_000_000  # on time for so long, it looks more often; where it had to take that back, for twice as long
LONGEST_TRIAL_NS = 16_000_000_000
_STEP_NS = 100_000_000  # a longer pause is one pause: who was stopped makes up for it


class Backlog:
    """How often to look, from how old the cycles are that have just closed.

    A pause is made up for: who was stopped publishes all that has waited, as far as that is done within PATIENCE_NS.
    Only where it is behind again and again does it look less often, and more often again, step by step, when it has
    been on time for a while.
    """

    def __init__(self, warn: Callable[[str], object] = lambda text: None) -> None:
        """`warn` is told when it begins to look less often."""
        self._warn = warn
        self._level = 0
        self._behind_ns = 0
        self._trial_ns = self._vain_ns = TRIAL_NS  # until the next step to more; after one that was in vain
        self._trying = False  # the last step was one to more
        self._looked_ns: int | None = None
        self._on_time_since_ns = 0

    @property
    def pause_ns(self) -> int:
        """How long to rest before each look, at least."""
        return PAUSES_NS[self._level]

    def newest_only(self, publishing_ns: int) -> bool:
        """Whether older cycles are to be left out, when those that closed have been published for `publishing_ns`."""
        return self._level > 0 or publishing_ns > PATIENCE_NS

    def look(self, oldest_ns: int, now_mono_ns: int) -> None:
        """Take note of the cycles that have just been found closed, the first of which closed at `oldest_ns`."""
        step_ns = min(_STEP_NS, now_mono_ns - (self._looked_ns if self._looked_ns is not None else now_mono_ns))
        self._looked_ns = now_mono_ns
        if now_mono_ns - oldest_ns > (self.pause_ns + OVERSLEPT_NS if self._level else OLD_NS):
            self._behind_ns += step_ns
            self._on_time_since_ns = now_mono_ns
        else:
            self._behind_ns = max(0, self._behind_ns - step_ns)
        if self._behind_ns > PATIENCE_NS and self._level < len(PAUSES_NS) - 1:
            if self._level == 0:
                self._warn("cannot keep up with the boards: some cycles are left out, the newest is published")
            self._vain_ns = min(2 * self._vain_ns, LONGEST_TRIAL_NS) if self._trying else self._vain_ns
            self._trial_ns, self._trying = self._vain_ns, False
            self._change(self._level + 1, now_mono_ns)
        elif self._level and now_mono_ns - self._on_time_since_ns > self._trial_ns:
            self._vain_ns = TRIAL_NS if self._trying else self._vain_ns
            self._trial_ns, self._trying = TRIAL_NS, True
            self._change(self._level - 1, now_mono_ns)

    def _change(self, level: int, now_mono_ns: int) -> None:
        self._level, self._behind_ns, self._on_time_since_ns = level, 0, now_mono_ns
