"""Detection of single taxels that are dead, stuck or saturated, by comparison with their neighbours.

An unloaded taxel and a dead one send the same counts, so a fault of a taxel shows only under load, for example in
walking. Each taxel is compared with its NEIGHBOURS nearest ones:

`saturated` – at 0, or at 255 if that is not the rest level, for SATURATED_NS, which takes two checks. Observable at
    once.
`dead` – it bears less than SHARE of the load of its least loaded neighbour, while that load is LOADED_COUNT or more.
    Observable once the least loaded neighbour has truly borne 48 kPa for 0.2 s, which is 6 counts of a taxel of the
    usual sensitivity and 4.4 of one less sensitive by two σ; a taxel whose neighbours never bear that is never judged.
`stuck` – CONTRAST_COUNT or more from its rest level while all its neighbours are at theirs, or so far above them that
    no load has such a gradient. Observable if it is stuck 5 counts or more from its rest level, once its neighbours
    have truly been unloaded for 0.2 s, or 5 counts below a fifth of it. A taxel stuck nearer to its rest level looks
    dead and is observable as such; a taxel stuck beyond the range of a count is saturated.

For dead and stuck, the evidence in counts is summed over the checks, between 0 and EVIDENCE_COUNT (a cumulative sum
test: E. S. Page 1954): the fault begins when the sum is full and ends when it is empty again.

Neither requires a constant count: a board that compensates temperature adds the noise of pad 6 to every taxel, also to
one with a constant converter value. Nor is a constant count a fault: at a high shift the counts show no noise.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ...compiled import kernel
from .places import Places
from .rest import Rest

NEIGHBOURS = 4  # enough to surround a taxel; more would reach beyond the edge of a load
LOADED_COUNT = 4.0  # four times the noise, and what 48 kPa show at least: sensitivities differ by 15 % (1 σ)
SHARE = 0.3  # of the least loaded neighbour; healthy ones bear half of it or more in walking
IDLE_COUNT = 2.0  # of the highest of the neighbours: twice the noise
CONTRAST_COUNT = 2.5  # above or below it; noise is 1, and creep leaves some per cent of 30 counts
SHARP = 5.0  # times the highest of them above it, under load: beyond what a cover lets through
EVIDENCE_COUNT = 8.0  # nine times the noise
ONE_LOOK_COUNT = 3.0  # largest evidence of one check: a single wrong frame makes no fault
SATURATED_NS, UNSATURATED_NS = 35_000_000, 3_000_000_000  # longer than a stride: at a low shift each step saturates

_LIMITS = np.array(
    [LOADED_COUNT, SHARE, IDLE_COUNT, CONTRAST_COUNT, SHARP, ONE_LOOK_COUNT, EVIDENCE_COUNT], np.float32
)  # as the kernel takes them


class TaxelState(IntEnum):
    """The fault of a taxel."""

    OK = 0
    DEAD = 1
    STUCK = 2
    SATURATED = 3


_OK, _DEAD, _STUCK, _SATURATED = map(int, TaxelState)


class TaxelFaults:
    """States of the n pressure taxels of one foot, in the order of `Places`."""

    def __init__(self, places: Places, rest: Rest) -> None:
        self._rest = rest
        n = len(places.taxel)
        xy = places.layout.xy_m.reshape(-1, 2)[places.taxel]
        distance = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
        np.fill_diagonal(distance, np.inf)
        self._neighbours = np.argsort(distance, axis=1, kind="stable")[:, :NEIGHBOURS].T.copy()  # (NEIGHBOURS, n)
        self.state = np.zeros(n, np.uint8)
        self._for_dead, self._for_stuck = np.zeros((2, n), np.float32)  # evidence
        self._on_rail = np.zeros(n, np.bool_)  # when it was last live
        self._rail_since_ns, self._rail_until_ns = np.zeros((2, n), np.int64)  # it was on one
        self._any_on_rail = False
        self._any_faulty = False
        self._changed = False

    def update(self, counts: NDArray[np.float32], live: NDArray[np.bool_], t_mono_ns: int) -> bool:
        """Check counts (n,) that `rest` has processed; return whether a state changed.

        live (n,): of a board and triangle in use, and new since the last check.
        """
        self._changed = False
        # Nearly always no count is at an end of its range, and none was.
        if self._any_faulty or self._any_on_rail or self._rest.any_at_top or np.count_nonzero(counts) < len(counts):
            live = live & ~self._saturated(counts, live, t_mono_ns)
        live = live & self._rest.known
        if np.count_nonzero(live):
            self._compare(live)
        if self._changed:
            self._any_faulty = bool(self.state.any())
        return self._changed

    def _compare(self, live: NDArray[np.bool_]) -> None:
        """Compare each taxel with its healthy neighbours; at least two of the four are needed."""
        if kernel is not None and not self._any_faulty:
            most_dead, most_stuck = kernel.compare(
                self._rest.activation, self._neighbours, live, self.state, self._for_dead, self._for_stuck, _LIMITS
            )
            if most_dead >= EVIDENCE_COUNT:
                self._become((self._for_dead >= EVIDENCE_COUNT) & (self.state < _DEAD), _DEAD)
            if most_stuck >= EVIDENCE_COUNT:
                self._become((self._for_stuck >= EVIDENCE_COUNT) & (self.state < _STUCK), _STUCK)
            return
        activation = self._rest.activation
        around = activation[self._neighbours]
        well = live & (self.state == _OK)
        if well.all():
            least, mean, highest = around.min(axis=0), around.sum(axis=0) / len(around), np.abs(around).max(axis=0)
        else:
            is_healthy = well[self._neighbours]
            n_healthy = is_healthy.sum(axis=0)
            least = np.where(is_healthy, around, np.inf).min(axis=0)
            borne = np.where(is_healthy, around, 0)
            mean, highest = borne.sum(axis=0) / np.maximum(n_healthy, 1), np.abs(borne).max(axis=0)
            live = live & (n_healthy >= 2)
        loaded = live & (least >= LOADED_COUNT)
        if loaded.any():
            self._weigh(self._for_dead, np.where(loaded, SHARE * least - activation, 0), _DEAD)
        # The highest of them, not their mean: at the edge of a load some bear nothing, and it is sharp all the same.
        above = highest - IDLE_COUNT
        more = np.abs(activation - mean) - CONTRAST_COUNT - SHARP * np.maximum(above, 0)
        more *= live
        if self._any_faulty:  # under load one that stuck among its neighbours' counts does not heal
            more[(above > 0) & (more < 0) & (self.state == _STUCK)] = 0
        self._weigh(self._for_stuck, more, _STUCK)

    def _weigh(self, evidence: NDArray[np.float32], more: NDArray[np.float32], state: int) -> None:
        """Add `more` (n,) to the evidence for `state` (n,)."""
        evidence += np.minimum(more, ONE_LOOK_COUNT)
        np.maximum(evidence, 0, out=evidence)
        np.minimum(evidence, EVIDENCE_COUNT, out=evidence)
        if evidence.max() >= EVIDENCE_COUNT:
            self._become((evidence >= EVIDENCE_COUNT) & (self.state < state), state)
        if self._any_faulty:
            self._mend((evidence <= 0) & (self.state == state))

    def _saturated(self, counts: NDArray[np.float32], live: NDArray[np.bool_], t_mono_ns: int) -> NDArray[np.bool_]:
        """Detect saturation; return which taxels are at the end of their range, (n,)."""
        rail: NDArray[np.bool_] = ((counts == 0) | self._rest.at_top) & live
        if rail.any() or self._any_on_rail:
            self._rail_since_ns[rail & ~self._on_rail] = t_mono_ns
            self._rail_until_ns[rail] = t_mono_ns
            self._on_rail = np.where(live, rail, self._on_rail)
            self._any_on_rail = bool(self._on_rail.any())
            long = t_mono_ns - self._rail_since_ns >= SATURATED_NS
            self._become(rail & long & (self.state < _SATURATED), _SATURATED)
        if self._any_faulty:
            saturated = self.state == _SATURATED
            self._mend(saturated & live & (t_mono_ns - self._rail_until_ns >= UNSATURATED_NS))
        return rail

    def _become(self, selected: NDArray[np.bool_], state: int) -> None:
        if selected.any():
            self.state[selected] = state
            self._changed = True

    def _mend(self, healed: NDArray[np.bool_]) -> None:
        self._become(healed, _OK)
        self._for_dead[healed] = self._for_stuck[healed] = 0
