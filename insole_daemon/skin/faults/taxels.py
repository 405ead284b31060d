"""Single taxels that are dead, stuck or saturated, judged against their neighbours.

An idle taxel and a dead one send the same, so a fault of a taxel can only be seen under load, and the load of walking
serves. Each is compared with its NEIGHBOURS nearest ones:

`saturated` – on a rail, at 0, or at 255 where that is not the rest level, for SATURATED_NS.
    Observable at once.
`dead` – its four neighbours are all loaded by LOADED_COUNT or more and it bears less than DEAD_SHARE of the least of
    them, over at least four such conversions; or it stays at rest without the least change while they move.
    Observable once the least of its four neighbours has truly borne 8 counts (64 kPa) for 0.1 s; a taxel whose
    neighbours never bear that much is never judged.
`stuck` – elsewhere than at rest, and not one count of change in STUCK_CONVERSIONS conversions, while the mean of its
    neighbours moved by MOVED_COUNT, or while it stands FAR_COUNT from its rest and they are at theirs.
    Observable once the mean of its neighbours has moved by 8 counts since it stuck, or, if it stuck 8 counts
    from its rest, once they are unloaded.

A conversion counts when any of the triangle's twelve counts changed: boards repeat conversions, and a triangle that is
quiet as a whole says nothing about one of its taxels.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ..layout import Layout
from .rest import LEARNED_CYCLES, NEAR_NO_LOAD_COUNT, Rest
from .triangles import REST_MARGIN

NEIGHBOURS = 4  # enough to stand around a taxel; more would reach beyond the edge of a load
LOADED_COUNT = 6.0  # six times the noise
DEAD_SHARE, HEALED_SHARE = 0.2, 0.4  # of the least loaded neighbour; a healthy one bore 0.45 or more in walking
FORGET = 0.75  # weight of the past at every loaded conversion: the last four count
DEAD_WEIGHT = 2.7  # 1 + 0.75 + 0.75² + 0.75³: four of them
STUCK_CONVERSIONS = 8  # at a noise of 0.9 counts a healthy one repeats itself so often in 2 of 10 000 cases
MOVED_COUNT = 7.0
FAR_COUNT = 8.0
AT_REST_COUNT = 2.5
HEALED_CONVERSIONS = 15  # without four equal ones in a row
SATURATED_NS, UNSATURATED_NS = 100_000_000, 1_000_000_000


class TaxelState(IntEnum):
    """What is wrong with a taxel."""

    OK = 0
    DEAD = 1
    STUCK = 2
    SATURATED = 3


class TaxelFaults:
    """States of the n pressure taxels of one foot, in the order of `Rest`."""

    def __init__(self, layout: Layout, rest: Rest) -> None:
        self._rest = rest
        n = len(rest.pressure)
        xy = layout.xy_m.reshape(-1, 2)[rest.pressure]
        distance = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
        np.fill_diagonal(distance, np.inf)
        k = min(NEIGHBOURS, n - 1)
        self._neighbours = np.argsort(distance, axis=1, kind="stable")[:, :k].T.copy()  # (k, n)
        self._top_is_rail = rest.level < 256 - REST_MARGIN
        self.state = np.zeros(n, np.uint8)
        self._before = np.full(n, -1, np.float32)
        self._run = np.zeros(n, np.int32)  # conversions without a change
        self._moving = np.zeros(n, np.int32)  # conversions without four equal ones in a row
        self._least, self._most = np.zeros((2, n), np.float32)  # of the neighbours' mean during the run
        self._own, self._theirs, self._weight = np.zeros((3, n), np.float32)  # forgetful sums while they are loaded
        self._on_rail_ns = np.zeros(n, np.int64)  # since when; 0: it is not
        self._off_rail_ns = np.zeros(n, np.int64)

    def update(
        self,
        counts: NDArray[np.float32],
        ok: NDArray[np.bool_],
        converted: NDArray[np.bool_],
        t_mono_ns: int,
    ) -> NDArray[np.uint8]:
        """(n,) states from counts (n,); ok: may be judged, converted: its triangle has a new conversion."""
        activation, state = self._rest.activation, self.state
        self._saturated(counts, ok, t_mono_ns)
        judged = ok & (state != TaxelState.SATURATED)
        around = np.where(judged & (state == 0), activation, np.nan)[self._neighbours]
        mean = around.mean(axis=0)  # NaN where a neighbour is not to be relied upon
        live = judged & converted
        unknown = np.isnan(mean)
        if unknown.any():  # beside a fault: what is left of the four, if there is any
            some = np.flatnonzero(unknown & live)
            there = ~np.isnan(around[:, some])
            mean[some] = np.where(there, around[:, some], 0).sum(axis=0) / np.maximum(there.sum(axis=0), 1)
            least = np.where(np.isnan(around), np.inf, around).min(axis=0)
            alone = some[there.sum(axis=0) < 2]
            mean[alone], least[alone] = 0.0, 0.0
            live[alone] = False
        else:
            least = around.min(axis=0)
        self._constant(counts, live, mean)
        learned = (self._rest.learned >= LEARNED_CYCLES)[self._rest.board]
        loaded = live & learned & (least >= LOADED_COUNT) & (least < np.inf)
        if loaded.any():
            self._unresponsive(loaded, activation, least)
        return state

    def _saturated(self, counts: NDArray[np.float32], ok: NDArray[np.bool_], t_mono_ns: int) -> None:
        rail = ok & ((counts == 0) | ((counts == 255) & self._top_is_rail))
        if rail.any() or self._on_rail_ns.any():
            self._on_rail_ns = np.where(rail, np.where(self._on_rail_ns > 0, self._on_rail_ns, t_mono_ns), 0)
            self._off_rail_ns[rail | ~ok] = t_mono_ns
            self.state[rail & (t_mono_ns - self._on_rail_ns >= SATURATED_NS)] = TaxelState.SATURATED
        saturated = self.state == TaxelState.SATURATED
        if saturated.any():
            healed = saturated & (t_mono_ns - self._off_rail_ns >= UNSATURATED_NS)
            self.state[healed] = TaxelState.OK
            self._run[healed] = self._weight[healed] = 0

    def _constant(self, counts: NDArray[np.float32], live: NDArray[np.bool_], mean: NDArray[np.float32]) -> None:
        changed = live & (counts != self._before)
        np.copyto(self._before, counts, where=live)
        self._run += live
        self._run[changed] = 0
        self._moving += live
        self._moving[self._run >= 4] = 0
        np.copyto(self._least, mean, where=live & ((self._run == 0) | (mean < self._least)))
        np.copyto(self._most, mean, where=live & ((self._run == 0) | (mean > self._most)))
        still = live & (self._run >= STUCK_CONVERSIONS)
        if still.any():
            away = np.abs(self._rest.activation)
            no_rest = np.abs(counts - self._rest.nominal) > NEAR_NO_LOAD_COUNT
            moved = self._most - self._least >= MOVED_COUNT
            far = ((away >= FAR_COUNT) | no_rest) & (np.abs(mean) <= AT_REST_COUNT)
            stuck = still & (moved | far) & (self.state == TaxelState.OK)
            if stuck.any():
                at_rest = (away <= AT_REST_COUNT) & ~no_rest
                self.state[stuck] = np.where(at_rest, TaxelState.DEAD, TaxelState.STUCK)[stuck]
        healed = (self.state == TaxelState.STUCK) & (self._moving >= HEALED_CONVERSIONS)
        if healed.any():
            self.state[healed] = TaxelState.OK
            self._weight[healed] = 0

    def _unresponsive(
        self, loaded: NDArray[np.bool_], activation: NDArray[np.float32], least: NDArray[np.float32]
    ) -> None:
        for total, new in ((self._own, activation), (self._theirs, least), (self._weight, 1.0)):
            np.copyto(total, FORGET * total + new, where=loaded)
        enough = loaded & (self._weight >= DEAD_WEIGHT)
        self.state[enough & (self._own < DEAD_SHARE * self._theirs) & (self.state == TaxelState.OK)] = TaxelState.DEAD
        answers = enough & (self._own > HEALED_SHARE * self._theirs) & (self._run < STUCK_CONVERSIONS)
        self.state[answers & (self.state == TaxelState.DEAD)] = TaxelState.OK
