"""Which readings of a cycle may be believed, from the protocol alone."""

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

    Invalid are: thermal pads; a triangle that never came, is older than `stale_after_ns` or reports an error
    (open or dead); a taxel flagged out of range; one clamped at 0 (saturated: the load is at least that, how much
    is not known) or at 255 (below the range; with a no-load of 255 that is the value at rest, and valid, and
    the flag is set there at zero load and says nothing).
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
        """What the kernel asks of each triangle, each (n_triangles,): believed readings, rests at 255, flags work."""
        parts = (self._n_readings, self._rests_at_255, self._flags_work)
        return tuple(part.ravel().astype(np.uint8) for part in parts)

    def __call__(
        self, counts: NDArray[np.uint8], status: NDArray[np.uint16], age_ns: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        """(…, n_triangles, 12) bool from counts (…, n_triangles, 12), status and age_ns (…, n_triangles)."""
        believed = age_ns.view(np.uint64) <= self.stale_after_ns  # never received is -1, the oldest of all
        valid: NDArray[np.bool_] = counts - np.uint8(1) < self._n_readings
        if np.count_nonzero(status):
            believed &= status & 0xF == 0
            flagged = (status[..., None] >> _FLAG_BIT & 1).astype(np.bool_) & self._flags_work
            valid &= ~flagged | ((counts == 255) & self._rests_at_255)
        valid &= self._pressure_taxel
        valid &= believed[..., None]
        return valid
