"""Rest levels of the taxels, learned while the foot is unloaded, and the activation of taxels and boards.

The board sets a taxel to the no-load count when it is zeroed; real taxels rest up to ten counts from it. The load of a
taxel is therefore measured from its learned rest level.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiled import kernel
from .places import Places

FIRST_UNLOADED_COUNT = 1.5  # as below, before rest levels are learned; standing bears 4 in the mean
UNLOADED_COUNT = 0.7  # mean activation of a board below which nothing presses it; its noise is 0.3 at most
NEAR_NO_LOAD_COUNT = 12.0  # a rest level further from the no-load is a fault, not a rest level
ENOUGH_LEARNED = 5  # unloaded checks after which a rest level is reliable
GAIN = 0.02  # of the running mean: some seconds of swing; drift and creep are slower
TOP_MARGIN = 6  # from 256 on down: a no-load in it lets a taxel rest at 255, by its noise and drift
CLIP_COUNT = -15.0, 40.0  # limits of one taxel in a board's mean: a single faulty one does not move it


_CLIP_COUNT = np.array(CLIP_COUNT, np.float32)  # as the kernel takes it


class Rest:
    """Rest levels of the n pressure taxels of one foot, and their activation."""

    def __init__(self, places: Places) -> None:
        n, n_boards = len(places.taxel), len(places.addresses)
        self._places = places
        # The firmware sends no_load − floor(value / 2^shift), which rests half a count above the no-load.
        nominal = places.no_load + (1 - 2.0**-places.shift) / 2
        self._nominal: NDArray[np.float32] = nominal[places.board].astype(np.float32)
        self._lowest = self._nominal - np.float32(NEAR_NO_LOAD_COUNT)
        self._highest = self._nominal + np.float32(NEAR_NO_LOAD_COUNT)
        self.usable = np.ones(n, np.bool_)
        self.n_usable = np.zeros(n_boards)
        self.activation = np.zeros(n, np.float32)  # rest level − count
        self.total = np.zeros(n_boards)  # sum over a board's usable taxels
        self.mean = np.zeros(n_boards)  # < 0: below the rest
        self._top_is_rail = (places.no_load < 256 - TOP_MARGIN)[places.board]
        self.at_top = np.zeros(n, np.bool_)  # at 255, below the range of the board
        self.any_at_top = False
        self.n_at_top = np.zeros(n_boards)  # of the usable ones
        self._first: NDArray[np.float32] = np.minimum(self._nominal, np.float32(255))
        self.level = self._first  # (n,) counts
        self.learned = np.zeros(n_boards, np.int64)  # unloaded looks at every board
        self.known = np.zeros(n, np.bool_)  # the taxels whose level has been learned
        self.use(self.usable)

    def forget(self, boards: NDArray[np.bool_]) -> None:
        """Learn the levels of `boards` (n_boards,) again, starting from the no-load: they may have been zeroed."""
        self.level = np.where(boards[self._places.board], self._first, self.level)
        self.learned[boards] = 0
        self.known = (self.learned >= ENOUGH_LEARNED)[self._places.board]

    def use(self, usable: NDArray[np.bool_]) -> None:
        """Use only the taxels `usable` (n,) from now on."""
        self.usable = usable
        self.n_usable = self._of_boards(usable)
        self._divisor = np.maximum(self.n_usable, 1.0)

    def update(self, counts: NDArray[np.float32]) -> None:
        """Process the counts (n,) of a cycle."""
        if kernel is not None:
            self.any_at_top = kernel.activate(
                counts, self.level, self._top_is_rail, self.usable, self._places.board, _CLIP_COUNT,
                self.activation, self.at_top, self.total, self.n_at_top,
            )  # fmt: skip
        else:
            np.subtract(self.level, counts, out=self.activation)
            np.equal(counts, 255, out=self.at_top)
            self.at_top &= self._top_is_rail
            self.any_at_top = bool(np.count_nonzero(self.at_top))
            self.n_at_top = self._of_boards(self.at_top & self.usable)
            self.total = self._of_boards(self.activation.clip(*_CLIP_COUNT) * self.usable)
        self.mean = self.total / self._divisor

    def _of_boards(self, of_taxels: NDArray[Any]) -> NDArray[np.float64]:
        """Return the sum of (n,) over the taxels of each board, (n_boards,), one after another."""
        return np.bincount(self._places.board, of_taxels, len(self.learned)).astype(np.float64)

    def unloaded(self) -> bool:
        """Return whether every board is near its rest level, neither above nor below."""
        return all(
            abs(mean) < (UNLOADED_COUNT if learned >= ENOUGH_LEARNED else FIRST_UNLOADED_COUNT)
            for mean, learned in zip(self.mean.tolist(), self.learned.tolist(), strict=True)
        )

    def learn(self, believed: NDArray[np.bool_], fresh_boards: NDArray[np.bool_]) -> None:
        """Move the levels of `believed` taxels (n,) towards the counts of this cycle; call it only without load.

        Faulty taxels learn too if they are near their level: a board may have been zeroed silently, by one noisy
        reading, and a taxel that then seems stuck is not.
        """
        self.learned[fresh_boards] += 1
        gain = (np.maximum(GAIN, 1 / (self.learned + 1.0)) * fresh_boards).astype(np.float32)
        near = believed & (np.abs(self.activation) <= NEAR_NO_LOAD_COUNT)
        level = self.level - gain[self._places.board] * self.activation * near
        self.level = level.clip(self._lowest, self._highest)
        if not self.known.all():
            self.known = (self.learned >= ENOUGH_LEARNED)[self._places.board]
