"""Readings of every triangle of every board without a layout, for `insole map`."""

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
    """The newest reading of every triangle on the bus, addressed by (board, triangle)."""

    def __init__(self) -> None:
        self._counts = np.zeros((N_BOARDS * N_NUMBERS, 12))
        self._error = np.zeros(N_BOARDS * N_NUMBERS, np.uint8)
        self._t_ns = np.full((N_BOARDS * N_NUMBERS, 2), _NEVER)  # of halves A and B

    def feed(self, batch: FrameBatch) -> None:
        """Add frames; other frames than skin frames are ignored."""
        cls = batch.can_id >> np.uint32(8)
        even = (batch.dlc == 8) & (batch.flags == 0)
        for half, tag in enumerate((TAG_A, TAG_B)):
            is_skin = (cls == CLASS_SKIN) | (cls == CLASS_LEGACY_SKIN)
            if tag == TAG_B:
                is_skin |= cls == CLASS_SECOND_HALF
            rows = np.flatnonzero(even & is_skin & (batch.data[:, 0] == tag))
            place = (batch.can_id[rows] & np.uint32(0xFF)).astype(np.intp)  # repeated: the last one is stored
            columns = _COUNTS_OF_TAG[tag]
            self._counts[place, columns] = batch.data[rows, 1 : 1 + columns.stop - columns.start]
            self._t_ns[place, half] = batch.t_mono_ns[rows]
            if tag == TAG_B:
                self._error[place] = batch.data[rows, 7] & 0xF

    def level_count(self, now_mono_ns: int) -> NDArray[np.float64]:
        """Return the mean count of the pressure taxels by [board, triangle], (16, 16).

        NaN if one of the halves did not arrive for half a second, or if the triangle reports an error (open or dead).
        """
        level: NDArray[np.float64] = self._counts[:, PRESSURE_TAXELS].mean(axis=1)
        level[(now_mono_ns - self._t_ns.min(axis=1) > _STALE_NS) | (self._error != 0)] = np.nan
        return level.reshape(N_BOARDS, N_NUMBERS)

    def has_arrived(self) -> NDArray[np.bool_]:
        """Return whether any frame of [board, triangle] arrived, (16, 16)."""
        arrived: NDArray[np.bool_] = (self._t_ns > _NEVER).any(axis=1).reshape(N_BOARDS, N_NUMBERS)
        return arrived

    def faulty(self) -> NDArray[np.bool_]:
        """Return whether [board, triangle] reports that it is open or dead, (16, 16)."""
        faulty: NDArray[np.bool_] = (self._error != 0).reshape(N_BOARDS, N_NUMBERS)
        return faulty
