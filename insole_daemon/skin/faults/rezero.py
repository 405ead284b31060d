"""Boards that took their baseline anew while somebody stood on them.

A board does that when it is configured, and by itself after five read errors; it tells nobody. From then on every
count is off by the load of that moment. Two marks, from the counts:

jump – within one cycle all loaded taxels of the board come to stand at their rest level, while the other boards
    go on bearing what they bore. After a gap in the stream (an MTB3 pauses for two periods) the same, if the others'
    load is nearly unchanged: within a longer gap a heel may rise.
negative – the mean of the board's taxels stands above their rest levels: what was zeroed away is missing when the
    load goes. Not with a no-load of 255, which leaves no room above.

Observable if the board's taxels bore 2 counts (16 kPa) in the mean when it was zeroed: by the jump at once if another
board bears load, else once it has been unloaded. Zeroed under less, or if all boards are zeroed together under a load that
stays, nothing is seen.

What a re-zeroed board says is wrong by an unknown load on every taxel, so all of it is masked until it has stood at
its rest levels for HEALED_NS while the rest of the foot was unloaded too: that is, until it was zeroed again without load,
or the load was away for another reason and no offset shows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .boards import BoardStreams
from .rest import Rest

LOADED_COUNT, LOADED_TAXELS = 4.0, 5  # what must have been loaded for a jump: four times the noise
LEFT = 0.12  # of their load after the jump; the steepest unloading of a heel in walking leaves 0.4 in 20 ms
AT_REST_COUNT = 1.8  # mean distance from the rest level; two noises of 0.9 give 1.0
OTHERS_TOTAL = 100.0  # counts over all taxels, 26 N at 8 kPa a count and 32.4 mm²
OTHERS_LEFT = 0.5  # of the other boards' load after a jump without a gap
OTHERS_SAME = 0.2  # after a gap: relative change of the others' load
GAP_PERIODS = 1.7  # a gap, if longer
GAP_NS = 500_000_000  # the longest over which loads are compared
NEGATIVE_COUNT = 1.25  # mean; rebound after long standing is some per cent of 20 counts
NEGATIVE_CYCLES, NEGATIVE_NS = 3, 80_000_000
HEALED_NS = 200_000_000  # of a swing of 0.4 s
MIN_TAXELS = 10  # of a board that may be judged, to say anything about it


class Rezeroed:
    """Which boards of one foot were zeroed under load."""

    def __init__(self, rest: Rest, period_ns: NDArray[np.int64]) -> None:
        """`period_ns` (n_boards,) as the boards were told."""
        n = len(rest.addresses)
        self._rest, self._period_ns = rest, period_ns
        self._own = [np.flatnonzero(rest.board == place) for place in range(n)]
        self.rezeroed = np.zeros(n, np.bool_)
        self.suspect = np.zeros(n, np.bool_)  # below its rest levels: neither to be learned from nor to be judged
        self._activation = np.zeros(len(rest.pressure), np.float32)  # of the newest cycle of each board
        self._ok = np.zeros(len(rest.pressure), np.bool_)
        self._total = np.zeros(n, np.float32)
        self._negative = np.zeros(n, np.int64)  # cycles
        self._negative_ns = np.zeros(n, np.int64)  # since when
        self._at_rest_ns = np.zeros(n, np.int64)  # since when; 0: it is not

    def update(self, ok: NDArray[np.bool_], streams: BoardStreams, t_mono_ns: int) -> NDArray[np.bool_]:
        """(n_boards,) re-zeroed; ok (n,) taxels that may be judged, `rest` has taken in the cycle."""
        rest = self._rest
        judged = streams.fresh & ~streams.crowded & ~streams.clash & (rest.usable_taxels >= MIN_TAXELS)
        total = rest.total
        others_before, others_now = self._total.sum() - self._total, total.sum() - total
        for place in np.flatnonzero(judged & ~self.rezeroed & (others_now > OTHERS_TOTAL)).tolist():
            if self._jumped(
                place, ok, int(streams.gap_ns[place]), float(others_before[place]), float(others_now[place])
            ):
                self.rezeroed[place] = True
                self._at_rest_ns[place] = 0
        below = rest.mean < -NEGATIVE_COUNT
        self.suspect = rest.mean < -NEGATIVE_COUNT / 2
        self._negative_ns[judged & below & (self._negative == 0)] = t_mono_ns
        self._negative += judged & below
        self._negative[judged & ~below] = 0
        found = (self._negative >= NEGATIVE_CYCLES) & (t_mono_ns - self._negative_ns >= NEGATIVE_NS)
        self.rezeroed |= found & judged
        if self.rezeroed.any():
            self._heal(ok, judged, t_mono_ns)
        np.copyto(self._activation, rest.activation, where=streams.fresh[rest.board])
        np.copyto(self._ok, ok, where=streams.fresh[rest.board])
        np.copyto(self._total, total, where=streams.fresh)
        return self.rezeroed

    def _jumped(self, place: int, ok: NDArray[np.bool_], gap_ns: int, others_before: float, others_now: float) -> bool:
        own = self._own[place]
        own = own[ok[own] & self._ok[own]]
        before = self._activation[own]
        loaded = before >= LOADED_COUNT
        if np.count_nonzero(loaded) < LOADED_TAXELS or gap_ns > GAP_NS:
            return False
        now = self._rest.activation[own]
        if now[loaded].sum() > LEFT * before[loaded].sum() or np.abs(now).mean() > AT_REST_COUNT:
            return False
        if gap_ns > GAP_PERIODS * self._period_ns[place]:
            return abs(others_now - others_before) <= OTHERS_SAME * others_before
        return others_now >= OTHERS_LEFT * others_before

    def _heal(self, ok: NDArray[np.bool_], judged: NDArray[np.bool_], t_mono_ns: int) -> None:
        unloaded = bool(self._rest.unloaded().all())
        for place in np.flatnonzero(self.rezeroed & judged).tolist():
            own = self._own[place]
            at_rest = unloaded and np.abs(self._rest.activation[own][ok[own]]).mean() <= AT_REST_COUNT
            if not at_rest:
                self._at_rest_ns[place] = 0
            elif not self._at_rest_ns[place]:
                self._at_rest_ns[place] = t_mono_ns
            elif t_mono_ns - self._at_rest_ns[place] >= HEALED_NS:
                self.rezeroed[place] = False
                self._negative[place] = 0
