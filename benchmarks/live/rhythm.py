"""How the floor and the peer wait for frames: the wake-up that did best for both.

Boards keep their rhythm, so the next cycle of a foot is complete one period after the last, give or take what
arbitration shifts (40 µs, 1 σ): sleep until shortly before, then wait for the last frames as they come.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

from benchmarks.lib import traffic
from insole_daemon.bus.frames import FRAME_TIME_NS

HALVES = 56  # of one foot's cycle
_EARLY_NS = 300_000
_FEW = 4  # with as few outstanding, waiting for each costs no more than sleeping
_SHORTEST_NS = 50_000  # a sleep below is not worth its two system calls


class Rhythm:
    """When the cycles of two feet were complete, and hence when to look again."""

    def __init__(self) -> None:
        self._last_ns = [0, 0]

    def complete(self, foot: int, t_ns: int) -> None:
        """A cycle of `foot` was complete with the frame the kernel stamped `t_ns`."""
        self._last_ns[foot] = t_ns

    def pause_s(self, outstanding: Sequence[int]) -> float:
        """How long no cycle will be complete, with so many halves of each foot outstanding; 0: wait for frames."""
        now_ns = time.time_ns()
        pause_ns = min(
            max(last_ns + traffic.PERIOD_NS - _EARLY_NS - now_ns, (n - 1) * FRAME_TIME_NS if n > _FEW else 0)
            for last_ns, n in zip(self._last_ns, outstanding, strict=True)
        )
        return pause_ns * 1e-9 if pause_ns > _SHORTEST_NS else 0.0
