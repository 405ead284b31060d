"""What every triangle of every board reads, without any layout: the eyes of `insole map`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..bus.frames import FrameBatch
from .geometry import PRESSURE_TAXELS
from .identifiers import CLASS_LEGACY_SKIN, CLASS_SECOND_HALF, CLASS_SKIN, TAG_A, TAG_B

N_BOARDS, N_NUMBERS = 16, 16  # addresses and triangle numbers, as the identifier has room for
_COUNTS_OF_TAG = {TAG_A: slice(0, 7), TAG_B: slice(7, 12)}
_STALE_NS = 500_000_000
_NEVER = -(1 << 62)


class Touch:
    """The newest of every triangle on the bus, addressed by (board, triangle)."""

    def __init__(self) -> None:
        self._counts = np.zeros((N_BOARDS * N_NUMBERS, 12))
        self._error = np.zeros(N_BOARDS * N_NUMBERS, np.uint8)
        self._t_ns = np.full((N_BOARDS * N_NUMBERS, 2), _NEVER)  # of halves A and B

    def feed(self, batch: FrameBatch) -> None:
        """Take in frames; all that are no skin frames are passed over."""
        cls = batch.can_id >> np.uint32(8)
        even = (batch.dlc == 8) & (batch.flags == 0)
        for half, tag in enumerate((TAG_A, TAG_B)):
            known = (cls == CLASS_SKIN) | (cls == CLASS_LEGACY_SKIN)
            if tag == TAG_B:
                known |= cls == CLASS_SECOND_HALF
            rows = np.flatnonzero(even & known & (batch.data[:, 0] == tag))
            place = (batch.can_id[rows] & np.uint32(0xFF)).astype(np.intp)  # repeated: the last stands
            columns = _COUNTS_OF_TAG[tag]
            self._counts[place, columns] = batch.data[rows, 1 : 1 + columns.stop - columns.start]
            self._t_ns[place, half] = batch.t_mono_ns[rows]
            if tag == TAG_B:
                self._error[place] = batch.data[rows, 7] & 0xF

    def level_count(self, now_mono_ns: int) -> NDArray[np.float64]:
        """(16, 16) mean count of the pressure taxels by [board, triangle].

        NaN where one of the halves did not come for half a second, or the triangle reports an error (open or dead).
        """
        level: NDArray[np.float64] = self._counts[:, PRESSURE_TAXELS].mean(axis=1)
        level[(now_mono_ns - self._t_ns.min(axis=1) > _STALE_NS) | (self._error != 0)] = np.nan
        return level.reshape(N_BOARDS, N_NUMBERS)

    def seen(self) -> NDArray[np.bool_]:
        """(16, 16) whether anything ever came from [board, triangle]."""
        seen: NDArray[np.bool_] = (self._t_ns > _NEVER).any(axis=1).reshape(N_BOARDS, N_NUMBERS)
        return seen

    def faulty(self) -> NDArray[np.bool_]:
        """(16, 16) whether [board, triangle] reports that it is open or dead."""
        faulty: NDArray[np.bool_] = (self._error != 0).reshape(N_BOARDS, N_NUMBERS)
        return faulty
