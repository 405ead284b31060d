"""Triangles that came loose, by the counts alone.

What the firmware's arithmetic makes of a triangle that is not there (icub-firmware, embot_app_application_theSkin.cpp
and mtb3/main_V3.c; the first line fills whole stretches of the public insole recordings):

    taxels 0–8, 10, 11    taxel 9    when
    0                     255        MTB4, skin type 0: an open data line
    0                     0          MTB4, other types; MTB3, baseline in the upper half
    255                   255        MTB3, baseline in the lower half
    255                   0          MTB4, skin type 0: a chip that reads 0

Recordings hold mixtures of 0 and 255 too, while a contact flickers. What all have in common is that the *thermal
pads* stand on a rail: pads 6 and 10 move by some tens of counts at the most, so that no load, however high, brings
them there. A full load on ten taxels is therefore never taken for a loose triangle.

With a no-load at 255 a triangle at rest stands on that rail itself: 255 then says nothing there, and an open triangle of
an MTB3 with its baseline in the lower half cannot be told from one at rest. One that never answered since its
board was zeroed sends the no-load on all twelve, without any noise; it is found where the others show noise.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ...config import Board
from ..geometry import THERMAL_PADS
from ..layout import Layout

GOOD_NS = 1_000_000_000  # so long a triangle must be good before it is believed again: flickering contacts
REST_MARGIN = 6  # a rest level this close to 255 reaches it by noise and drift: 255 is no rail there
ON_RAILS = 10  # of 12; contacts that flicker leave one or two in between
DEAF_CYCLES = 100  # without one change among twelve taxels: at a noise of 0.9 counts not even 3 in a row occur
NOISY_SHIFT = 4  # up to this shift the noise reaches the counts at rest

_PAD_A, _PAD_B = THERMAL_PADS
_HALF_A = 7  # taxels 0–6 come in half A, 7–11 in half B


class LooseTriangles:
    """Which triangles of one foot are loose, cycle by cycle."""

    def __init__(self, layout: Layout, boards: Mapping[int, Board]) -> None:
        n = len(layout)
        own = [boards[t.board] for t in layout.triangles]
        self._no_load = np.array([board.no_load for board in own], np.uint8)
        self._top_is_rail = (self._no_load < 256 - REST_MARGIN)[:, None]
        self._rests_at_top = ~self._top_is_rail[:, 0]
        self._noisy = np.array([board.shift <= NOISY_SHIFT for board in own])
        self.loose = np.zeros(n, np.bool_)
        self.deaf = np.zeros(n, np.bool_)  # of the loose, those that never answered since the board was zeroed
        self._bad_ns = np.zeros(n, np.int64)  # when it was last bad, monotonic clock
        self._quiet = np.zeros(n, np.int64)  # fresh cycles without a change
        self._all_quiet = np.zeros(12, np.bool_)

    def update(
        self,
        counts: NDArray[np.uint8],
        fresh: NDArray[np.bool_],
        changed: NDArray[np.bool_],
        t_mono_ns: int,
    ) -> NDArray[np.bool_]:
        """(n_triangles,) loose, from counts (n_triangles, 12); fresh: new halves came, changed: with new counts.

        Found in the first cycle, also where only one half of that cycle is newer than the fault.
        """
        rail = counts == 0
        rail |= (counts == 255) & self._top_is_rail
        in_a = rail[:, :_HALF_A].sum(axis=1)
        in_b = rail[:, _HALF_A:].sum(axis=1)
        pad_a, pad_b = rail[:, _PAD_A], rail[:, _PAD_B]
        bad: NDArray[np.bool_] = (pad_a & (in_a == _HALF_A)) | (pad_b & (in_b == 12 - _HALF_A))
        bad |= (in_a + in_b >= ON_RAILS) & (pad_a | pad_b)
        if self._rests_at_top.any():  # a chip that reads 0: its taxel 9 alone is at 0, and all others at 255
            bad |= (counts[:, 9] == 0) & ((counts == 255).sum(axis=1) == 11)
        self._quiet += fresh
        self._quiet[changed] = 0
        quiet = self._quiet >= DEAF_CYCLES
        if quiet.any():
            at_rest = (counts == self._no_load[:, None]).all(axis=1)
            listening = self._noisy & fresh & ~quiet
            deaf = (
                quiet & at_rest & self._noisy & bool(np.median(self._quiet[listening]) <= 2 if listening.any() else 0)
            )
            self.deaf[:] = deaf | (self.deaf & at_rest)
            bad |= self.deaf
        elif self.deaf.any():
            self.deaf[:] = False
        self._bad_ns[bad] = t_mono_ns
        self.loose |= bad
        if self.loose.any():
            self.loose &= bad | ~fresh | (t_mono_ns - self._bad_ns < GOOD_NS)
        return self.loose
