"""Measured rates of each board: how often it sends, and how often its values change.

A board repeats its last conversion if its period is shorter than that of its converters (27 Hz), and a host that
publishes faster than the boards send repeats their readings. The two rates distinguish these cases.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from .assembler import CycleAssembler
from .layout import Layout

_NEVER = -(1 << 62)  # so long ago that every rate since is 0

BoardState = Literal["never seen", "silent", "streaming"]


@dataclass(frozen=True, slots=True)
class BoardReport:
    """State and rates of one board between two surveys."""

    address: int
    state: BoardState
    rate_hz: float  # halves of one kind per second: how often the board sends
    change_rate_hz: float  # how often its most active half changed: how often there was something new
    age_ms: float | None  # of its newest half; None: never seen
    missed: int  # halves of this board that were expected and did not come, since the start


class BoardSurvey:
    """Reports on the boards of one foot from what its assembler has counted."""

    def __init__(self, layout: Layout) -> None:
        board = np.repeat([triangle.board for triangle in layout.triangles], 2)
        self._slots = {address: np.flatnonzero(board == address) for address in dict.fromkeys(board.tolist())}
        self._arrivals = self._changes = np.zeros(len(board), np.int64)
        self._surveyed_ns = _NEVER

    def __call__(self, assembler: CycleAssembler, now_mono_ns: int, stale_after_ns: int) -> list[BoardReport]:
        """Return a report for each board since the last call, at `now_mono_ns`; the first call gives rates of 0."""
        assembler.settle()
        arrivals, changes = assembler.arrivals - self._arrivals, assembler.changes - self._changes
        self._arrivals, self._changes = assembler.arrivals.copy(), assembler.changes.copy()
        elapsed_s = max(1, now_mono_ns - self._surveyed_ns) * 1e-9
        self._surveyed_ns = now_mono_ns
        reports = []
        for address, slots in self._slots.items():
            sending = slots[assembler.arrivals[slots] > 0]
            if not len(sending):
                reports.append(BoardReport(address, "never seen", 0.0, 0.0, None, int(assembler.missed[slots].sum())))
                continue
            age_ns = now_mono_ns - int(assembler.last_arrival_ns()[sending].max())
            reports.append(
                BoardReport(
                    address,
                    "silent" if age_ns > stale_after_ns else "streaming",
                    rate_hz=float(np.median(arrivals[sending])) / elapsed_s,
                    change_rate_hz=float(changes[sending].max()) / elapsed_s,
                    age_ms=age_ns * 1e-6,
                    missed=int(assembler.missed[slots].sum()),
                )
            )
        return reports
