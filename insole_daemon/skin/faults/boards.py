"""Boards that fall silent, restart, or share their address with another one: told from when halves come.

`silent` – not one triangle of the board came for SILENT_PERIODS of its periods and SILENT_NS at least.
`reset` – it came back after having been silent. A board that restarts and stays away is only silent: MTB4
    and MTB3 do not stream after power-up until they are told to.
`address_clash` – halves of a triangle come at CLASH_RATE times the rate its board was told, or more. Two boards that send
    the same identifiers do that, each in its own time. If *all* boards that send do so, it is the configuration
    that is wrong, and no clash.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ...config import Board
from ..layout import Layout

SILENT_PERIODS, SILENT_NS = 5, 200_000_000  # a bus that is full for 0.1 s is no silent board
NEVER_SEEN_NS = 1_000_000_000  # boards may take that long to start
STEADY_NS = 2_000_000_000  # so long after its return a board counts as restarted
WINDOW_PERIODS, WINDOW_NS = 8, 400_000_000  # in which arrivals are counted
CLASH_RATE, SINGLE_RATE = 1.6, 1.3  # times the nominal rate; one period of jitter in eight makes 1.13
SINGLE_NS = 1_000_000_000  # so long a clash must be over
CROWDED_NS = 400_000_000  # after more halves came than one board sends: until a clash is found or ruled out
EARLY = 0.7  # of a period: a triangle that comes again so early is crowded


class BoardStreams:
    """How the boards of one foot send."""

    def __init__(self, layout: Layout, boards: Mapping[int, Board]) -> None:
        addresses = [t.board for t in layout.triangles]
        self.addresses = list(dict.fromkeys(addresses))
        n = len(self.addresses)
        board = np.array([self.addresses.index(a) for a in addresses])
        self._triangles = [np.flatnonzero(board == place) for place in range(n)]
        self._period_ns = np.array([boards[a].period_ms * 1_000_000 for a in self.addresses], np.int64)
        self._silent_ns = np.maximum(SILENT_PERIODS * self._period_ns, SILENT_NS)
        self._window_ns = max(WINDOW_NS, WINDOW_PERIODS * int(self._period_ns.max()))
        self.silent = np.zeros(n, np.bool_)
        self.reset = np.zeros(n, np.bool_)
        self.clash = np.zeros(n, np.bool_)
        self.crowded = np.zeros(n, np.bool_)  # more came than one board sends: not yet a clash, but not to be judged
        self.gap_ns = np.zeros(n, np.int64)  # between the newest halves and the ones before
        self.fresh = np.zeros(n, np.bool_)  # something came in this cycle
        self._start_ns: int | None = None
        self._last_ns = np.zeros(n, np.int64)  # monotonic time of the newest triangle; 0: never
        self._returned_ns = np.zeros(n, np.int64)
        self._crowded_ns = np.full(n, -(1 << 62))
        self._clash_ns = np.zeros(n, np.int64)
        self._arrived = np.zeros(len(layout), np.int64)
        self._history: deque[tuple[int, NDArray[np.int64]]] = deque()

    def update(self, t_mono_ns: int, age_ns: NDArray[np.int64], arrived: NDArray[np.uint8]) -> None:
        """Take in a cycle that closed at `t_mono_ns`; age_ns and arrived (n_triangles,) as in Cycles."""
        if self._start_ns is None:
            self._start_ns = t_mono_ns
        self._arrived += arrived
        for place, own in enumerate(self._triangles):
            ages = age_ns[own]
            ages = ages[ages >= 0]
            newest_ns = t_mono_ns - int(ages.min()) if len(ages) else 0
            last_ns = int(self._last_ns[place])
            came = newest_ns > last_ns
            self.fresh[place] = came
            if came:
                self.gap_ns[place] = newest_ns - last_ns if last_ns else 0
                if self.silent[place]:
                    self.silent[place] = False
                    self.reset[place] = last_ns > 0
                    self._returned_ns[place] = t_mono_ns
                early = last_ns and newest_ns - last_ns < EARLY * self._period_ns[place]
                if early or int(arrived[own].max()) > 2:
                    self._crowded_ns[place] = t_mono_ns
                self._last_ns[place] = newest_ns
            else:
                limit_ns = int(self._silent_ns[place]) if last_ns else NEVER_SEEN_NS
                if t_mono_ns - (last_ns or self._start_ns) > limit_ns:
                    self.silent[place] = True
                    self.reset[place] = False
            if self.reset[place] and t_mono_ns - int(self._returned_ns[place]) > STEADY_NS:
                self.reset[place] = False
        self.crowded = t_mono_ns - self._crowded_ns < CROWDED_NS
        self._count(t_mono_ns)

    def _count(self, t_mono_ns: int) -> None:
        history = self._history
        history.append((t_mono_ns, self._arrived.copy()))
        while len(history) > 1 and t_mono_ns - history[1][0] >= self._window_ns:
            history.popleft()
        since_ns, before = history[0]
        if t_mono_ns - since_ns < self._window_ns // 2:
            return
        # Normal is 2 halves of a triangle a period. A short first window counts as a whole one, or a burst would tell.
        came = self._arrived - before
        elapsed_ns = max(t_mono_ns - since_ns, self._window_ns)
        most = np.array([came[own].max() for own in self._triangles])
        rate = most * self._period_ns / (2 * elapsed_ns)
        live = ~self.silent
        everybody = np.count_nonzero(live) > 1 and bool((rate[live] >= CLASH_RATE).all())
        self._clash_ns[rate >= SINGLE_RATE] = t_mono_ns
        if not everybody:
            self.clash |= rate >= CLASH_RATE
        self.clash &= t_mono_ns - self._clash_ns < SINGLE_NS
