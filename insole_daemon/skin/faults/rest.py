"""What every taxel rests at, learned while nobody stands on the foot, and how far from it each board is.

The no-load is where the board put the taxel when it was zeroed; real ones rest up to ten counts from it. Everything
that is said about a taxel's load is said against its learned rest level.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ...config import Board
from ..geometry import PRESSURE_TAXELS
from ..layout import Layout

UNLOADED_COUNT = 0.7  # mean activation of a board below which nothing presses it; its noise is below 0.2
NEAR_NO_LOAD_COUNT = 12.0  # a rest level further from the no-load is a fault, not a rest level
LEARNED_CYCLES = 5  # unloaded cycles after which a rest level may be relied upon
GAIN = 0.02  # of the running mean: about a second of swing; drift and creep are slower
CLIP_COUNT = 15.0  # of one taxel in a board's mean, so that a single faulty one does not move it


class Rest:
    """Rest levels of the pressure taxels of one foot, n of them: row-major, thermal pads left out."""

    def __init__(self, layout: Layout, boards: Mapping[int, Board]) -> None:
        self.pressure = np.flatnonzero(np.tile(PRESSURE_TAXELS, len(layout)))  # (n,) among the 12 · n_triangles
        self.triangle = self.pressure // 12  # (n,)
        addresses = [t.board for t in layout.triangles]
        self.addresses = list(dict.fromkeys(addresses))
        place = np.array([self.addresses.index(a) for a in addresses])
        self.board_of_triangle = place
        self.board = place[self.triangle]  # (n,) place of its board
        self._members = (self.board == np.arange(len(self.addresses))[:, None]).astype(np.float32)
        rest = np.array([boards[a].no_load + (1 - 2.0 ** -boards[a].shift) / 2 for a in addresses])
        self.nominal = rest[self.triangle].astype(np.float32)
        self.level = np.minimum(self.nominal, 255).astype(np.float32)  # (n,) counts
        self.learned = np.zeros(len(self.addresses), np.int64)  # unloaded cycles of every board
        self.activation = np.zeros(len(self.pressure), np.float32)  # (n,) rest level − count
        self.mean = np.zeros(len(self.addresses), np.float32)  # (n_boards,) clipped activation; < 0: below the rest
        self.total = np.zeros(len(self.addresses), np.float32)  # (n_boards,) its sum
        self.usable_taxels = np.zeros(len(self.addresses), np.float32)  # (n_boards,)

    def update(self, counts: NDArray[np.float32], ok: NDArray[np.bool_]) -> None:
        """Take in the counts (n,) of a cycle; ok (n,) says which of them may be judged."""
        np.subtract(self.level, counts, out=self.activation)
        clipped = np.clip(self.activation, -CLIP_COUNT, None)
        clipped *= ok
        self.total = self._members @ clipped
        self.usable_taxels = self._members @ ok.astype(np.float32)
        self.mean = self.total / np.maximum(self.usable_taxels, 1)

    def unloaded(self) -> NDArray[np.bool_]:
        """(n_boards,) nothing presses it, and it is not below its rest either."""
        found: NDArray[np.bool_] = (np.abs(self.mean) < UNLOADED_COUNT) | (self.usable_taxels == 0)
        return found

    def learn(self, ok: NDArray[np.bool_], fresh_boards: NDArray[np.bool_]) -> None:
        """Move the levels towards the counts of this cycle; only to be called while the whole foot is unloaded."""
        self.learned[fresh_boards] += 1
        gain = np.maximum(GAIN, 1 / (self.learned[self.board] + 1.0)) * (ok & fresh_boards[self.board])
        self.level -= (gain * self.activation).astype(np.float32)
        np.clip(self.level, self.nominal - NEAR_NO_LOAD_COUNT, self.nominal + NEAR_NO_LOAD_COUNT, out=self.level)
        np.minimum(self.level, 255, out=self.level)
