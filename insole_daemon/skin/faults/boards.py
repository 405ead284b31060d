"""Detection of boards that are silent, restarted, or share an address, from the number of received halves.

`silent` – nothing arrived from the board for SILENT_PERIODS of its periods, and SILENT_NS at least.
`reset` – it sends again after a silence: it lost power, or its cable. A board that does not return is only silent,
    because boards do not send after power-up until they are started.
`clash` – halves of one triangle arrive at CLASH_RATE times the configured rate of its board, or more: two boards with
    the same address do that, each at its own times. It is checked only after more halves arrived at once than one board
    sends: a board that sends evenly, but faster than configured, is no clash. If *all* of several boards do so, the
    configuration is wrong.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from .places import Places

SILENT_PERIODS, SILENT_NS = 5, 150_000_000  # an MTB3 that takes its baseline pauses for three periods
STEADY_NS = 2_000_000_000  # how long after its return a board counts as restarted
WINDOW_PERIODS, WINDOW_NS = 8, 400_000_000  # in which halves are counted
CLASH_RATE, SINGLE_RATE = 1.4, 1.2  # times the nominal rate; one period of jitter in eight makes 1.13
SINGLE_NS = 1_000_000_000  # how long a clash must be absent before it ends
CROWDED_NS = 400_000_000  # after more halves at once than one board sends: until a clash is detected or ruled out
HANDED_ON_NS = 100_000_000  # in which a delayed host delivers the frames that arrived meanwhile
PAUSE_PERIODS = 2.5  # without a frame: an MTB3 that takes its baseline pauses for three
LATE_PERIODS = 0.5  # by which a half may be late while the next one is in time


class BoardStreams:
    """The sending behaviour of the boards of one foot; all arrays are (n_boards,)."""

    def __init__(self, places: Places) -> None:
        n = len(places.addresses)
        self._places = places
        self._period_ns: list[int] = places.period_ns.tolist()
        self._silent_ns = [max(SILENT_PERIODS * period_ns, SILENT_NS) for period_ns in self._period_ns]
        self._window_ns = max(WINDOW_NS, WINDOW_PERIODS * max(self._period_ns))
        self.seen = np.zeros(n, np.bool_)
        self.silent = np.zeros(n, np.bool_)
        self.reset = np.zeros(n, np.bool_)
        self.clash = np.zeros(n, np.bool_)
        self.crowded = np.zeros(n, np.bool_)  # more halves at once than one board sends: not yet a clash
        self.paused = np.zeros(n, np.bool_)  # until the reader of this resets it
        self._any_crowded = False
        self._arrivals = np.zeros(len(places.layout), np.int64)
        self._last_ns = [0] * n
        self._returned_ns = [0] * n
        self._crowded_ns = [-(1 << 62)] * n
        self._clash_ns = [0] * n
        self._pause_ns = [0] * n  # without anything, until
        self._pause_end_ns = [-(1 << 62)] * n
        self._history: deque[tuple[int, NDArray[np.int64]]] = deque()

    def update(self, t_mono_ns: int, arrivals: NDArray[np.int64]) -> bool:
        """Process the halves received until a cycle closed, (n_triangles,); return whether a state changes."""
        if not self._history:
            self._last_ns = [t_mono_ns] * len(self._last_ns)
        most = self._places.most_of_board(arrivals - self._arrivals).tolist()
        self._arrivals = arrivals
        changed = False
        for board, halves in enumerate(most):
            changed |= self._arrived(board, halves, t_mono_ns) if halves else self._stayed_away(board, t_mono_ns)
        self._history.append((t_mono_ns, arrivals))
        while len(self._history) > 1 and t_mono_ns - self._history[1][0] >= self._window_ns:
            self._history.popleft()
        if self._any_crowded:
            self.crowded[:] = [t_mono_ns - crowded_ns < CROWDED_NS for crowded_ns in self._crowded_ns]
            changed |= self._count(t_mono_ns)
            self._any_crowded = bool(self.crowded.any() or self.clash.any())
        return changed

    def _arrived(self, board: int, halves: int, t_mono_ns: int) -> bool:
        """Process `halves` that a triangle of the board sent since the cycle before; return whether a state changed."""
        gap_ns, period_ns = t_mono_ns - self._last_ns[board], self._period_ns[board]
        self._last_ns[board] = t_mono_ns
        if gap_ns > PAUSE_PERIODS * period_ns:
            self.paused[board] = True
            recent = t_mono_ns - self._pause_end_ns[board] < self._window_ns
            self._pause_ns[board] = gap_ns + (self._pause_ns[board] if recent else 0)
            self._pause_end_ns[board] = t_mono_ns
        if self.seen[board] and halves > 2 * (gap_ns / period_ns + LATE_PERIODS):
            self._crowded_ns[board] = t_mono_ns
            self._any_crowded = True
        changed = False
        if not self.seen[board] or self.silent[board]:
            if self.seen[board]:
                self.reset[board] = True
                self._returned_ns[board] = t_mono_ns
            self.seen[board], self.silent[board] = True, False
            changed = True
        elif self.reset[board] and t_mono_ns - self._returned_ns[board] > STEADY_NS:
            self.reset[board] = False
            changed = True
        return changed

    def _stayed_away(self, board: int, t_mono_ns: int) -> bool:
        if self.silent[board] or t_mono_ns - self._last_ns[board] <= self._silent_ns[board]:
            return False
        self.silent[board], self.reset[board] = True, False
        return True

    def _held_up_ns(self, t_mono_ns: int) -> NDArray[np.int64]:
        """Return the recent pauses, (n_boards,): a delayed host delivers the frames of a pause at its end."""
        return np.array([
            pause_ns if t_mono_ns - end_ns < self._window_ns + HANDED_ON_NS else 0
            for pause_ns, end_ns in zip(self._pause_ns, self._pause_end_ns, strict=True)
        ])  # fmt: skip

    def _count(self, t_mono_ns: int) -> bool:
        """Detect clashes by the rates over the window; normal is two halves of a triangle in a period."""
        since_ns, before = self._history[0]
        # A short first window counts as a whole one; otherwise a burst would look like a clash.
        elapsed_ns = max(t_mono_ns - since_ns, self._window_ns) + self._held_up_ns(t_mono_ns)
        rate = self._places.most_of_board(self._arrivals - before) * self._places.period_ns / (2 * elapsed_ns)
        for board in np.flatnonzero(rate >= SINGLE_RATE).tolist():
            self._clash_ns[board] = t_mono_ns
        live = ~self.silent
        clash = self.clash.copy()
        if np.count_nonzero(live) < 2 or not (rate[live] >= CLASH_RATE).all():
            clash |= rate >= CLASH_RATE
        clash &= [t_mono_ns - clash_ns < SINGLE_NS for clash_ns in self._clash_ns]
        changed = bool((clash != self.clash).any())
        self.clash = clash
        return changed
