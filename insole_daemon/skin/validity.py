"""Validity of the readings of a cycle, from the protocol alone."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..config import Board
from .geometry import THERMAL_PADS
from .layout import Layout

_FLAG_BIT = np.arange(4, 16, dtype=np.uint16)  # status bit of every taxel's out-of-range flag
_FLAGS_BROKEN_FROM_SHIFT = 7  # an MTB3 overflows its 16-bit arithmetic there, and the flags mean nothing


class Validity:
    """Marks the readings of one foot that carry no pressure.

    Invalid are: thermal pads; a triangle that never arrived, is older than `stale_after_ns` or reports an error
    (open or dead); a taxel flagged out of range; a taxel clamped at 0 (saturated: only a lower bound of the load is
    known) or at 255 (below the range). With a no-load of 255, the count 255 is the unloaded value and valid; the flag
    is then set without load and is ignored.
    """

    def __init__(self, layout: Layout, boards: Mapping[int, Board], stale_after_ns: int) -> None:
        no_load = np.array([boards[t.board].no_load for t in layout.triangles])[:, None]
        shift = np.array([boards[t.board].shift for t in layout.triangles])[:, None]
        self.stale_after_ns = stale_after_ns
        self._rests_at_255 = no_load == 255
        self._n_readings = np.where(self._rests_at_255, np.uint8(255), np.uint8(254))  # from 1 up that are believed
        self._flags_work = shift < _FLAGS_BROKEN_FROM_SHIFT
        self._pressure_taxel = np.ones(12, np.bool_)
        self._pressure_taxel[list(THERMAL_PADS)] = False

    def of_triangles(self) -> tuple[NDArray[np.uint8], ...]:
        """Return the settings for the kernel, each (n_triangles,): number of valid counts, rests at 255, flags work."""
        settings = (self._n_readings, self._rests_at_255, self._flags_work)
        return tuple(setting.ravel().astype(np.uint8) for setting in settings)

    def __call__(
        self, counts: NDArray[np.uint8], status: NDArray[np.uint16], age_ns: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        """Return validity (…, n_triangles, 12) from counts (…, n_triangles, 12), status and age_ns (…, n_triangles)."""
        believed = age_ns.view(np.uint64) <= self.stale_after_ns  # never received is -1, the oldest of all
        valid: NDArray[np.bool_] = counts - np.uint8(1) < self._n_readings
        if np.count_nonzero(status):
            believed &= status & 0xF == 0
            flagged = (status[..., None] >> _FLAG_BIT & 1).astype(np.bool_) & self._flags_work
            valid &= ~flagged | ((counts == 255) & self._rests_at_255)
        valid &= self._pressure_taxel
        valid &= believed[..., None]
        return valid
