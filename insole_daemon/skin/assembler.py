"""Assemble frames into cycles and close them.

A cycle closes
- **complete**, the moment the last expected half has arrived since the previous one closed;
- **late**, when an expected half is missing a `slack` after the cycle was due (one `period` after the previous);
- as a **repeat**, one `period` after the previous, while no half at all is expected.

A half is expected as long as it arrives at least every `period + slack`. A half that is missing for PATIENCE cycles
(a silent board, a board configured with 50 ms) is no longer waited for: its last value is repeated with its true age.
It is expected again from the first time it arrives twice within `period + slack`.

A half that arrives again within TWICE_NS, with no other half of its board in between, is a retransmission: its
controller sent it once more because a node had missed it. It completes nothing; otherwise, after a retransmission of
the half that closes a cycle, all later cycles would close before that half arrives. With other halves in between it is
the next reading, however soon: an adapter or a host that was delayed delivers successive frames at once.

The result depends on the receive times of the frames alone, never on when or in what portions they are read: a replay
gives the same cycles as the live run.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .assembler_state import NEVER, AssemblerState
from .cycles import ClosedCycle, Cycles
from .half_arrays import decode_counts, decode_status, previous_rows, previous_values, row_offsets

PATIENCE = 3  # cycles a half may miss before it is no longer waited for

TWICE_NS = 500_000  # four frames; boards read a half once a millisecond at the most

GAP_NS = 60_000_000_000  # a silence longer than this is not filled with repeats

_WINDOW_CYCLES = 4  # frames of this many cycles are searched for the end of one
_FRAME_BY_FRAME_CYCLES = 12  # frames of up to this many cycles go to the kernel one by one; more go to numpy in blocks
_INTERVALS = 8  # in the mean interval between cycles: a single one has the jitter of both its ends
_BLOCK_CYCLES, _BLOCK_CYCLES_MOST = 4, 256  # fewest (unless there are fewer) and most complete cycles of a block


# slots, payload, t_ns, t_mono_ns of n frames
_Frames = tuple[NDArray[np.int16], NDArray[np.uint64], NDArray[np.int64], NDArray[np.int64]]
_Held = tuple[NDArray[np.bool_], NDArray[np.int16], NDArray[np.uint64], NDArray[np.int64], NDArray[np.int64]]


class CycleAssembler(AssemblerState):
    """Closes the cycles of one foot.

    `boards` (n_triangles,) has the address of the board of each triangle, `period_ns` is the publish period, `slack_ns`
    the longest delay of a cycle by a missing half. `first_slot` is the first slot of this foot among those of all feet.
    """

    def __init__(self, boards: NDArray[np.uint8], period_ns: int, slack_ns: int, first_slot: int = 0) -> None:
        super().__init__(boards)
        self._first_slot = first_slot
        self.n_triangles = len(boards)
        self._period_ns = period_ns
        self._limit_ns = period_ns + slack_ns
        self._held: list[_Held] = []  # fed and not looked at: fewer than outstanding, all in time
        self.n_held = 0
        self._block_pause = 0  # cycles to take the careful way before blocks are tried again
        self._block_failures = 0
        self.compiled = None if kernel is None else kernel.assembly(
            self.kernel_arrays,
            (first_slot, period_ns, self._limit_ns, TWICE_NS, GAP_NS, PATIENCE, _INTERVALS),
        )  # fmt: skip

    @property
    def expected(self) -> NDArray[np.bool_]:
        """The halves that are waited for, (2 · n_triangles,) bool."""
        return self._expected

    @property
    def due_ns(self) -> int | None:
        """Monotonic time at which the open cycle closes even with halves missing; None before the first frame."""
        return self._due_ns

    @property
    def outstanding(self) -> int:
        """Least number of frames until the open cycle is complete; 0: it waits for time alone."""
        return self._outstanding - self.n_held

    @property
    def promised_ns(self) -> int | None:
        """Monotonic time at which the open cycle completes if the boards stay periodic; None while they are not."""
        return self._promised_ns

    def last_arrival_ns(self) -> NDArray[np.int64]:
        """Return the monotonic receive time of every half's newest frame, (2 · n_triangles,); −2^62: never."""
        return self._t_mono_ns

    def feed(
        self,
        slots: NDArray[np.int16],
        data: NDArray[np.uint8],
        t_ns: NDArray[np.int64],
        t_mono_ns: NDArray[np.int64],
    ) -> list[Cycles]:
        """Add n frames, slots (n,), data (n, 8), including those of other feet; return the cycles that they close."""
        if self.compiled is not None and len(slots) <= _FRAME_BY_FRAME_CYCLES * len(self._seen):
            return [cycle.cycles for cycle in self.closed_cycles(slots, data, t_ns, t_mono_ns)]
        foot_slots = slots - np.int16(self._first_slot)
        is_own = foot_slots.view(np.uint16) < len(self._seen)
        n_own = int(np.count_nonzero(is_own))
        if not n_own:
            return []
        if self._due_ns is None:
            self._due_ns = int(t_mono_ns[is_own.argmax()]) + self._limit_ns
        self._held.append((is_own, foot_slots, data.view(np.uint64)[:, 0], t_ns, t_mono_ns))
        self.n_held += n_own
        # Too few to complete the cycle: they are processed together with those that do.
        if self.n_held < self._outstanding and t_mono_ns[-1] <= self._due_ns:
            return []
        slots, payload, t_ns, t_mono_ns = self._take_held()
        closed: list[Cycles] = []
        n, at = len(slots), 0
        while at < n:
            block = self._feed_block(slots[at:], payload[at:], t_ns[at:], t_mono_ns[at:])
            if block is not None:
                closed.append(block)
                at += len(block) * int(np.count_nonzero(self._expected))
                continue
            window = slice(at, at + _WINDOW_CYCLES * len(self._seen))
            available = len(slots[window])
            n_used = self._end_of_cycle(slots[window], t_mono_ns[window])
            rows = slice(at, at + n_used)
            self._absorb(slots[rows], payload[rows], t_ns[rows], t_mono_ns[rows])
            at += n_used
            if self._expected.any() and not self._outstanding:
                closed.append(self._close(int(t_mono_ns[at - 1]), late=False))
            elif n_used < available:
                self._skip_gap(int(t_mono_ns[at]))
                closed.append(self._close_by_time())
        return closed

    def closed_cycles(
        self,
        slots: NDArray[np.int16],
        data: NDArray[np.uint8],
        t_ns: NDArray[np.int64],
        t_mono_ns: NDArray[np.int64],
    ) -> list[ClosedCycle]:
        """As `feed`, each cycle by itself."""
        if self.compiled is None:
            closed = self.feed(slots, data, t_ns, t_mono_ns)
            return [ClosedCycle.of(cycles, at) for cycles in closed for at in range(len(cycles))]
        self.settle()
        return [ClosedCycle(*cycle) for cycle in kernel.feed(self.compiled, slots, data, t_ns, t_mono_ns)]

    def cycles_closed_by_time(self, now_mono_ns: int) -> list[ClosedCycle]:
        """As `advance`, each cycle by itself."""
        if self.compiled is None:
            return [ClosedCycle.of(cycles, 0) for cycles in self.advance(now_mono_ns)]
        self.settle()
        return [ClosedCycle(*cycle) for cycle in kernel.advance(self.compiled, now_mono_ns)]

    def advance(self, now_mono_ns: int) -> list[Cycles]:
        """Close the cycles that are due at `now_mono_ns` and return them; every earlier frame must have been fed."""
        if self.compiled is not None:
            return [cycle.cycles for cycle in self.cycles_closed_by_time(now_mono_ns)]
        if self._due_ns is None or now_mono_ns <= self._due_ns:
            return []
        self.settle()
        closed: list[Cycles] = []
        while self._due_ns is not None and now_mono_ns > self._due_ns:
            self._skip_gap(now_mono_ns)
            closed.append(self._close_by_time())
        return closed

    def settle(self) -> None:
        """Update the counters to the last frame fed; this changes no cycle."""
        if self.n_held:
            self._absorb(*self._take_held())

    def _take_held(self) -> _Frames:
        held = self._held
        self._held, self.n_held = [], 0
        is_own, slots, payload, t_ns, t_mono_ns = (
            held[0] if len(held) == 1 else map(np.concatenate, zip(*held, strict=True))
        )
        rows = is_own.nonzero()[0]
        return slots[rows], payload[rows], t_ns[rows], t_mono_ns[rows]

    def _end_of_cycle(self, slots: NDArray[np.int16], t_mono_ns: NDArray[np.int64]) -> int:
        """Return how many of these frames belong to the open cycle."""
        assert self._due_ns is not None
        in_time = int(np.searchsorted(t_mono_ns, self._due_ns, side="right"))
        first = np.full(len(self._seen), len(slots))
        since_ns = t_mono_ns - previous_values(slots, t_mono_ns, self._t_mono_ns)
        rows = np.flatnonzero(~self._is_retransmission(slots, since_ns))[::-1]
        first[slots[rows]] = rows  # the earliest arrival is written last
        needed = first[self._expected & ~self._seen]
        return min(int(needed.max()) + 1, in_time) if needed.size else in_time

    def _is_retransmission(self, slots: NDArray[np.int16], since_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which of these halves are retransmissions, (n,); `since_ns` is the time since the half before."""
        soon = since_ns < TWICE_NS
        if np.count_nonzero(soon):
            soon &= previous_values(self._board[slots], slots, self._newest_slot) == slots
        return soon

    def _absorb(
        self,
        slots: NDArray[np.int16],
        payload: NDArray[np.uint64],
        t_ns: NDArray[np.int64],
        t_mono_ns: NDArray[np.int64],
    ) -> None:
        """Add frames to the open cycle; the last arrival of a half replaces earlier ones."""
        n = len(slots)
        if not n:
            return
        self._newest_t_ns = int(t_ns[-1])
        n_slots = len(self._seen)
        since_ns = t_mono_ns - previous_values(slots, t_mono_ns, self._t_mono_ns)
        new = ~self._is_retransmission(slots, since_ns)
        n_seen_before = int(np.count_nonzero(self._seen))
        self._seen[slots[new]] = True
        n_seen = int(np.count_nonzero(self._seen))
        self._fresh = n_seen > 0
        self.superseded += n - (n_seen - n_seen_before)
        self._outstanding = int(np.count_nonzero(self._expected & ~self._seen))
        in_time = slots[new & (since_ns <= self._limit_ns)]
        self._misses[in_time] = 0
        self._returning[in_time] = True
        self.arrivals += np.bincount(slots, minlength=n_slots)
        self.changes += np.bincount(slots[payload != previous_values(slots, payload, self._bytes)], minlength=n_slots)
        self._bytes[slots] = payload  # repeated slots: the last assignment stands
        self._t_ns[slots] = t_ns
        self._t_mono_ns[slots] = t_mono_ns
        self._newest_slot[self._board[slots]] = slots

    def _skip_gap(self, t_mono_ns: int) -> None:
        """Skip the repeats of a silence until `t_mono_ns` if it is longer than GAP_NS."""
        assert self._due_ns is not None
        if t_mono_ns - self._due_ns > GAP_NS and not self._fresh:
            periods = (t_mono_ns - self._due_ns) // self._period_ns
            self.skipped += periods
            self._due_ns += periods * self._period_ns

    def _close_by_time(self) -> Cycles:
        """Close the open cycle at its due time; stop expecting halves that are missing for PATIENCE cycles."""
        assert self._due_ns is not None
        late = bool(self._expected.any())
        absent = self._expected & ~self._seen
        self.missed += absent
        self._misses += absent
        cycle = self._close(self._due_ns, late)
        self._expected &= self._misses < PATIENCE
        self._begin_cycle(int(cycle.t_mono_ns[0]), complete=False)
        return cycle

    def _close(self, t_close_ns: int, late: bool) -> Cycles:
        complete = not late and self._outstanding == 0
        cycle = self._closed(t_close_ns, late)
        self._fresh = False
        self._begin_cycle(t_close_ns, complete)
        return cycle

    def _closed(self, t_close_ns: int, late: bool) -> Cycles:
        """Return the present cycle and mark all halves as not seen."""
        t_a, t_b = self._t_mono_ns[::2], self._t_mono_ns[1::2]
        t_older = np.minimum(t_a, t_b)
        halves = self._bytes.view(np.uint8).reshape(1, -1, 16)
        absent = self._expected & ~self._seen
        cycle = Cycles(
            t_mono_ns=np.array([t_close_ns]),
            t_ns=np.array([self._newest_t_ns]),
            counts=decode_counts(halves),
            status=decode_status(halves),
            triangle_t_ns=np.where(t_a <= t_b, self._t_ns[::2], self._t_ns[1::2])[None],  # 0 where never received
            age_ns=np.where(t_older == NEVER, -1, t_close_ns - t_older)[None],
            arrivals=(self.arrivals[::2] + self.arrivals[1::2])[None],
            missing=(absent[::2] | absent[1::2])[None],
            late=np.array([late]),
            repeated=np.array([not self._fresh]),
        )
        self._expected |= self._returning
        self._returning[:] = False
        self._seen[:] = False
        return cycle

    def _begin_cycle(self, t_close_ns: int, complete: bool) -> None:
        if not complete or self._complete_ns is None:
            self._interval_ns = None
        else:
            interval_ns = t_close_ns - self._complete_ns
            mean_ns = interval_ns if self._interval_ns is None else self._interval_ns
            self._interval_ns = mean_ns + (interval_ns - mean_ns) // _INTERVALS
        self._promised_ns = None if self._interval_ns is None else t_close_ns + self._interval_ns
        self._complete_ns = t_close_ns if complete else None
        self._outstanding = int(np.count_nonzero(self._expected))
        self._waiting = self._outstanding > 0
        self._due_ns = t_close_ns + (self._limit_ns if self._waiting else self._period_ns)

    def _feed_block(
        self,
        slots: NDArray[np.int16],
        payload: NDArray[np.uint64],
        t_ns: NDArray[np.int64],
        t_mono_ns: NDArray[np.int64],
    ) -> Cycles | None:
        """Return the leading cycles that are complete and in time, or None if there are none or too few.

        The result is that of frame-by-frame processing, at a fraction of the time, live and for long logs.
        """
        expected = self._expected
        size, n_slots = int(np.count_nonzero(expected)), len(expected)
        if size == 0 or len(slots) < size or self._due_ns is None or self._fresh:
            return None
        if self._block_pause:
            self._block_pause -= 1
            return None
        n = min(len(slots) // size, _BLOCK_CYCLES_MOST)
        place = (
            slots[: n * size] if n == 1 else (slots[: n * size].reshape(n, size) + row_offsets(n, n_slots)).reshape(-1)
        )
        stamp_mono = np.empty((n, n_slots), np.int64)
        stamp_mono.fill(NEVER)
        stamp_mono.reshape(-1)[place] = t_mono_ns[: n * size]
        t_close = t_mono_ns[: n * size].reshape(n, size)[:, -1]
        since_ns = t_close.copy()
        since_ns[1:] -= t_close[:-1]
        since_ns[0] -= self._due_ns - self._limit_ns
        intervals = stamp_mono - previous_rows(self._t_mono_ns, stamp_mono)
        in_time, complete = since_ns <= self._limit_ns, ((stamp_mono != NEVER) & (intervals >= TWICE_NS)) == expected
        if np.count_nonzero(in_time) < n or np.count_nonzero(complete) < n * n_slots:
            n_good = int((in_time & complete.all(axis=1)).argmin())
            if n_good < min(n, _BLOCK_CYCLES):
                self._block_failures = min(self._block_failures + 1, 6)
                self._block_pause = 1 << self._block_failures
                return None
            n, place, t_close, stamp_mono = n_good, place[: n_good * size], t_close[:n_good], stamp_mono[:n_good]
            intervals = intervals[:n_good]
        self._block_failures = 0
        used = n * size
        table, stamp = np.empty((n, n_slots), np.uint64), np.empty((n, n_slots), np.int64)
        if size < n_slots:
            table[:], stamp[:] = self._bytes, self._t_ns
            stamp_mono[:, ~expected] = self._t_mono_ns[~expected]
        table.reshape(-1)[place] = payload[:used]
        stamp.reshape(-1)[place] = t_ns[:used]
        if np.count_nonzero(self._misses):
            self._misses[expected & (intervals <= self._limit_ns).any(axis=0)] = 0
        self.changes += np.add.reduce(table != previous_rows(self._bytes, table), axis=0)
        arrivals = self.arrivals + np.arange(1, n + 1)[:, None] * expected
        self.arrivals[:] = arrivals[-1]
        self._bytes[:], self._t_ns[:], self._t_mono_ns[:] = table[-1], stamp[-1], stamp_mono[-1]
        newest = slots[used - size : used]
        self._newest_slot[self._board[newest]] = newest
        t_newest = t_ns[:used].reshape(n, size)[:, -1]
        self._newest_t_ns = int(t_newest[-1])
        t_a, t_b = stamp_mono[:, ::2], stamp_mono[:, 1::2]
        t_older = np.minimum(t_a, t_b)
        triangle_t_ns, age_ns = np.where(t_a <= t_b, stamp[:, ::2], stamp[:, 1::2]), t_close[:, None] - t_older
        if size < n_slots:
            age_ns[t_older == NEVER] = -1
        halves = table.view(np.uint8).reshape(n, -1, 16)
        if n > 1:
            self._complete_ns = int(t_close[-2])
        self._begin_cycle(int(t_close[-1]), complete=True)
        return Cycles(
            t_mono_ns=t_close.copy(),
            t_ns=t_newest.copy(),
            counts=decode_counts(halves),
            status=decode_status(halves),
            triangle_t_ns=triangle_t_ns,
            age_ns=age_ns,
            arrivals=arrivals[:, ::2] + arrivals[:, 1::2],
            missing=np.zeros((n, self.n_triangles), np.bool_),
            late=np.zeros(n, np.bool_),
            repeated=np.zeros(n, np.bool_),
        )
