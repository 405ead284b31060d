"""Reduce the polling rate of a loop that cannot keep up, and publish only the newest cycle of each poll.

Waking up costs more than the work that follows, so a loop that polls half as often needs little more than half of the
CPU. A loop that stays below its share of the CPU is not preempted in the middle of a cycle.
"""

from __future__ import annotations

from collections.abc import Callable

OLD_NS = 100_000_000  # at the full rate, cycles up to this age are published late rather than left out
OVERSLEPT_NS = 40_000_000  # delay beyond a pause that counts as being behind
PATIENCE_NS = 300_000_000  # time behind, less time on schedule, before the rate is reduced
PAUSES_NS = (0, 15_000_000, 30_000_000, 60_000_000, 120_000_000, 240_000_000)  # before each poll: 50 to 4 Hz
TRIAL_NS = 1_000_000_000  # time on schedule before the rate is raised; doubled after a raise that had to be undone
LONGEST_TRIAL_NS = 16_000_000_000
_STEP_NS = 100_000_000  # longer gaps count as this much: a process that was stopped once catches up


class Backlog:
    """Chooses the polling rate from the age of the cycles that have just closed.

    After a single pause, all waiting cycles are published, as far as that takes less than PATIENCE_NS. Only a loop that
    is behind repeatedly polls less often. The rate is raised again step by step once the loop has been on schedule for
    a while.
    """

    def __init__(self, warn: Callable[[str], object] = lambda text: None) -> None:
        """`warn` is called with a message when the rate is reduced from the full one."""
        self.has_quota = False  # a tight one of CPU time: older cycles of a poll are then left out at any rate
        self._warn = warn
        self._level = 0
        self._behind_ns = 0
        self._trial_ns = self._failed_trial_ns = TRIAL_NS  # until the rate is raised; after a raise that failed
        self._is_trial = False  # the last change raised the rate
        self._polled_ns: int | None = None
        self._on_time_since_ns = 0

    @property
    def pause_ns(self) -> int:
        """Least pause before each poll."""
        return PAUSES_NS[self._level]

    def newest_only(self, publishing_ns: int) -> bool:
        """Return whether older cycles are left out, given the time that publishing has taken so far."""
        return self._level > 0 or self.has_quota or publishing_ns > PATIENCE_NS

    def record_poll(self, oldest_ns: int, now_mono_ns: int) -> None:
        """Take into account a poll that found closed cycles, the oldest of which closed at `oldest_ns`."""
        step_ns = min(_STEP_NS, now_mono_ns - (self._polled_ns if self._polled_ns is not None else now_mono_ns))
        self._polled_ns = now_mono_ns
        if now_mono_ns - oldest_ns > (self.pause_ns + OVERSLEPT_NS if self._level else OLD_NS):
            self._behind_ns += step_ns
            self._on_time_since_ns = now_mono_ns
        else:
            self._behind_ns = max(0, self._behind_ns - step_ns)
        if self._behind_ns > PATIENCE_NS and self._level < len(PAUSES_NS) - 1:
            if self._level == 0:
                self._warn("cannot keep up with the boards: some cycles are left out, the newest is published")
            self._failed_trial_ns = (
                min(2 * self._failed_trial_ns, LONGEST_TRIAL_NS) if self._is_trial else self._failed_trial_ns
            )
            self._trial_ns, self._is_trial = self._failed_trial_ns, False
            self._change(self._level + 1, now_mono_ns)
        elif self._level and now_mono_ns - self._on_time_since_ns > self._trial_ns:
            self._failed_trial_ns = TRIAL_NS if self._is_trial else self._failed_trial_ns
            self._trial_ns, self._is_trial = TRIAL_NS, True
            self._change(self._level - 1, now_mono_ns)

    def _change(self, level: int, now_mono_ns: int) -> None:
        self._level, self._behind_ns, self._on_time_since_ns = level, 0, now_mono_ns
