"""Detection of boards that were re-zeroed under load.

A board takes a new baseline when it is configured, and by itself after five read errors; it does not report this. From
then on every count is off by the load of that moment. Two signs, from the counts:

jump – from one check to the next, all loaded taxels of a board under steady load change to their rest level, while the
    load of the other boards stays the same. Pauses of the board (an MTB3 pauses for three periods) are bridged; if the
    others paused too, the host or the bus was delayed, and a heel may have risen meanwhile.
negative – the mean of the board's taxels is above their rest levels, or PINNED of them are at 255: the load that was
    zeroed is missing after unloading. This is not used with a no-load of 255, which has no range above it, nor if the
    mean was nearly as high in the last unloaded phase: a drifting rest level creeps there step by step.

Observable if the board's taxels bore 2 counts (16 kPa) in the mean when it was zeroed: by the jump at once if another
board bears load, five taxels bore 4 counts and the board sends every 200 ms or faster; otherwise after unloading. A
re-zero under less load, or of all boards together under a load that stays, is not detected.

The readings of a re-zeroed board are wrong by an unknown load on every taxel. The whole board is therefore masked until
it has been at its rest levels for HEALED_NS while the rest of the foot was unloaded: until it was zeroed without load.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .boards import BoardStreams
from .places import Places
from .rest import Rest

LOADED_COUNT, LOADED_TAXELS = 4.0, 5  # four times the noise, and how many such a jump needs
LOADED_MEAN = 1.5  # of the whole board, before a jump
LEFT = 0.3  # share of their load after the jump, by noise; the fastest unloading of a heel leaves 0.16 in two cycles, …
STEADY = 0.2  # … but begins earlier: largest relative change of the board's own load in the check before
AT_REST_COUNT = 1.8  # mean distance from the rest level; two noises of 0.9 give 1.0
OTHERS_TOTAL = 100.0  # counts over all taxels, 26 N at 8 kPa a count and 32.4 mm²
OTHERS_SAME = 0.2  # largest relative change of their load meanwhile: in two cycles of walking a heel may rise
OTHERS_NOISE, OWN_NOISE = 100.0, 75.0  # counts: three times the noise of a change, pad 6 makes it common to a triangle
PAUSE_NS = 200_000_000  # longest pause that is bridged
HELD_UP_PERIODS = 3.0  # without a frame of any other board: a check is two periods after the last
CONFIRM_NS = 60_000_000  # in which a jump turns out to be another board's frames, or a board that falls silent
NEGATIVE_COUNT = 1.25  # mean; rebound after long standing is some per cent of 20 counts, the noise 0.3 at most
CREEPS_COUNT = 0.6  # mean, from one step to the next
PINNED = 5  # more than can be stuck there
NEGATIVE_NS = 80_000_000
HEALED_NS = 200_000_000  # of a swing of 0.4 s
MIN_TAXELS = 30  # usable taxels that a board needs to be judged: three triangles

_NEVER = 1 << 62


class Rezeroed:
    """The boards of one foot that were re-zeroed under load."""

    def __init__(self, places: Places, rest: Rest) -> None:
        n = len(places.addresses)
        self._rest = rest
        self._held_up_ns = int(HELD_UP_PERIODS * int(places.period_ns.max()))
        self._own = [np.flatnonzero(places.board == board) for board in range(n)]
        self.rezeroed = np.zeros(n, np.bool_)
        self.suspect = [False] * n  # below its rest levels: not used for learning or judging
        self._activation = [np.zeros_like(rest.activation)] * n  # of all taxels, at the last reading of each board
        self._total = [0.0] * n
        self._total_before = [0.0] * n
        self._n_usable = [0.0] * n
        self._looked_ns = [0] * n
        self._jumped_ns = [_NEVER] * n
        self._negative_ns = [_NEVER] * n  # since when
        self._at_rest_ns = [_NEVER] * n  # since when
        self._lowest = [0.0] * n  # mean since the board was last loaded, and
        self._lowest_before = [0.0] * n  # from then back to when it was loaded before

    def forget(self) -> None:
        """Use every board again."""
        n = len(self._own)
        self.rezeroed[:] = False
        self._jumped_ns, self._negative_ns, self._at_rest_ns = [_NEVER] * n, [_NEVER] * n, [_NEVER] * n
        self._lowest, self._lowest_before = [0.0] * n, [0.0] * n

    def update(self, streams: BoardStreams, fresh_boards: NDArray[np.bool_], t_mono_ns: int) -> bool:
        """Check a cycle that `rest` has processed; return whether `rezeroed` changed.

        fresh_boards (n_boards,): a frame arrived since the check before.
        """
        rest = self._rest
        before, total = self._total, rest.total.tolist()
        mean, n_usable, pinned = rest.mean.tolist(), rest.n_usable.tolist(), rest.n_at_top.tolist()
        fresh, crowded, clash = fresh_boards.tolist(), streams.crowded.tolist(), streams.clash.tolist()
        all_before, all_now = sum(before), sum(total)
        unloaded = bool(np.count_nonzero(self.rezeroed)) and rest.unloaded()
        others_went_on = self._others_went_on(t_mono_ns)
        changed = False
        for board, taxels in enumerate(self._own):
            self.suspect[board] = mean[board] < -NEGATIVE_COUNT / 2 or pinned[board] >= PINNED
            if crowded[board] or clash[board] or streams.silent[board] or n_usable[board] < MIN_TAXELS:
                self._jumped_ns[board] = self._negative_ns[board] = self._at_rest_ns[board] = _NEVER
                continue
            if not fresh[board]:
                continue
            if self.rezeroed[board]:
                changed |= self._healed(board, unloaded, t_mono_ns)
                continue
            if mean[board] > LOADED_MEAN and self._lowest[board] < 0:
                self._lowest_before[board], self._lowest[board] = self._lowest[board], 0.0
            self._lowest[board] = min(self._lowest[board], mean[board])
            above = -mean[board] > max(NEGATIVE_COUNT, CREEPS_COUNT - self._lowest_before[board])
            full = pinned[board] >= PINNED and self._lowest_before[board] > -CREEPS_COUNT
            if not (above or full):
                self._negative_ns[board] = _NEVER
            elif self._negative_ns[board] == _NEVER:
                self._negative_ns[board] = t_mono_ns
            others_before, others_now = all_before - before[board], all_now - total[board]
            if (
                n_usable[board] == self._n_usable[board]
                and before[board] > LOADED_MEAN * n_usable[board]
                and abs(before[board] - self._total_before[board]) <= max(STEADY * before[board], OWN_NOISE)
                and total[board] < before[board] / 2
                and others_now >= OTHERS_TOTAL
                and abs(others_now - others_before) <= OTHERS_SAME * others_before + OTHERS_NOISE
                and others_went_on[board]
                and t_mono_ns - self._looked_ns[board] <= PAUSE_NS
                and self._at_rest_at_once(board, taxels)
            ):
                self._jumped_ns[board] = t_mono_ns
            if t_mono_ns - self._jumped_ns[board] >= CONFIRM_NS or t_mono_ns - self._negative_ns[board] >= NEGATIVE_NS:
                self.rezeroed[board] = changed = True
                self._jumped_ns[board] = self._negative_ns[board] = self._at_rest_ns[board] = _NEVER
        self._total = [now if new else old for now, old, new in zip(total, before, fresh, strict=True)]
        self._n_usable = n_usable
        activation = rest.activation.copy()
        for board, is_fresh in enumerate(fresh):
            if is_fresh:
                self._total_before[board] = before[board]
                self._activation[board] = activation
                self._looked_ns[board] = t_mono_ns
        return changed

    def _others_went_on(self, t_mono_ns: int) -> list[bool]:
        """Return for each board whether another one was checked recently."""
        lately = [t_mono_ns - looked_ns <= self._held_up_ns for looked_ns in self._looked_ns]
        return [sum(lately) > is_recent for is_recent in lately]

    def _at_rest_at_once(self, board: int, taxels: NDArray[np.intp]) -> bool:
        usable = self._rest.usable[taxels]
        before, activation_now = self._activation[board][taxels][usable], self._rest.activation[taxels][usable]
        loaded = before >= LOADED_COUNT
        if np.count_nonzero(loaded) < LOADED_TAXELS or np.abs(activation_now).mean() > AT_REST_COUNT:
            return False
        return bool(activation_now[loaded].sum() <= LEFT * before[loaded].sum())

    def _healed(self, board: int, unloaded: bool, t_mono_ns: int) -> bool:
        taxels = self._own[board]
        distance = np.abs(self._rest.activation[taxels][self._rest.usable[taxels]]).mean()
        if not unloaded or distance > AT_REST_COUNT or self.suspect[board]:
            self._at_rest_ns[board] = _NEVER
        elif self._at_rest_ns[board] == _NEVER:
            self._at_rest_ns[board] = t_mono_ns
        elif t_mono_ns - self._at_rest_ns[board] >= HEALED_NS:
            self.rezeroed[board] = False
            self._lowest[board] = self._lowest_before[board] = 0.0  # that was the fault, not creep
            return True
        return False
