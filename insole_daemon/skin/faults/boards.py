"""Boards that fall silent, come back, or share their address with another one: told from how many halves come.

`silent` – nothing came from the board for SILENT_PERIODS of its periods, and SILENT_NS at least.
`reset` – it came back after having been silent: it lost power, or its cable. One that stays away is only silent:
    boards do not stream after power-up until they are told to.
`clash` – halves of one triangle come at CLASH_RATE times the rate its board was told, or more: two boards that bear
    one address do that, each in its own time. Looked for where more came at once than one board sends: one board that
    sends faster than told, evenly, is none. If *all* of several boards do so, it is the configuration that is wrong.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from .places import Places

SILENT_PERIODS, SILENT_NS = 5, 150_000_000  # an MTB3 that takes its baseline pauses for three periods
STEADY_NS = 2_000_000_000  # so long after its return a board counts as restarted
WINDOW_PERIODS, WINDOW_NS = 8, 400_000_000  # in which halves are counted
CLASH_RATE, SINGLE_RATE = 1.4, 1.2  # times the nominal rate; one period of jitter in eight makes 1.13
SINGLE_NS = 1_000_000_000  # so long a clash must be over
CROWDED_NS = 400_000_000  # after more came at once than one board sends: until a clash is found or ruled out
HANDED_ON_NS = 100_000_000  # in which a host that was held up hands on what came meanwhile
PAUSE_PERIODS = 2.5  # without anything: an MTB3 that takes its baseline pauses for three
LATE_PERIODS = 0.5  # that a half may come late, and the next one in time


class BoardStreams:
    """How the boards of one foot send; all arrays (n_boards,)."""

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
        self.crowded = np.zeros(n, np.bool_)  # more came at once than one board sends: not yet a clash
        self.paused = np.zeros(n, np.bool_)  # since whoever looks at this said False
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
        """Take in the halves that came until a cycle closed, (n_triangles,) as in Cycles; whether a state changed."""
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
        """`halves` of one triangle came from the board since the cycle before."""
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
        """(n_boards,) pauses that ended lately: what came in one, a host that was held up hands on at its end."""
        return np.array([
            pause_ns if t_mono_ns - end_ns < self._window_ns + HANDED_ON_NS else 0
            for pause_ns, end_ns in zip(self._pause_ns, self._pause_end_ns, strict=True)
        ])  # fmt: skip

    def _count(self, t_mono_ns: int) -> bool:
        """Rates over the window; normal is two halves of a triangle a period."""
        since_ns, before = self._history[0]
        # A short first window counts as a whole one, or a burst would tell.
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
