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

One that was loose when its board was zeroed sends the same twelve counts for ever, and so does one that is frozen;
that is told from a triangle at rest by the noise of the others.

With a no-load near 255 a triangle at rest stands on that rail itself: 255 then says nothing there, and an open triangle
of an MTB3 with its baseline in the lower half is found only as one without noise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...compiled import kernel
from ..geometry import THERMAL_PADS
from .places import Places
from .rest import TOP_MARGIN

GOOD_NS = 3_000_000_000  # so long it must be good before it is believed again: contacts flicker; more than DEAF_LOOKS
ON_RAILS = 10  # of 12; contacts that flicker leave one or two in between
DEAF_LOOKS = 60  # without one change among twelve taxels: at a noise of 0.9 counts not even 3 in a row occur
LIVELY_LOOKS = 2  # in so many the triangle in the middle changes, if noise shows at all
NOISY_SHIFT = 4  # up to this shift the noise of some eight codes reaches the counts at rest

_PAD_A, _PAD_B = THERMAL_PADS
_PADS = slice(_PAD_A, None, _PAD_B - _PAD_A)
_HALF_A = 7  # taxels 0–6 come in half A, 7–11 in half B


class LooseTriangles:
    """Which triangles of one foot are loose, cycle by cycle."""

    def __init__(self, places: Places) -> None:
        n = len(places.layout)
        of_triangle = places.board_of_triangle
        self.top_is_rail: NDArray[np.bool_] = (places.no_load[of_triangle] < 256 - TOP_MARGIN)[:, None]
        self._rests_at_top = not self.top_is_rail.all()
        self._noisy = places.shift[of_triangle] <= NOISY_SHIFT
        self.loose = np.zeros(n, np.bool_)
        self._any = False
        self._bad_ns = np.zeros(n, np.int64)  # when it was last bad, monotonic clock
        self._deaf = np.zeros(n, np.bool_)
        self._quiet = np.zeros(n, np.int64)  # looks without a change

    def must_update(self, counts: NDArray[np.uint8]) -> bool:
        """Whether counts (n_triangles, 12) may change anything: a pad on a rail, or a loose triangle that may heal."""
        if kernel is not None:
            return self._any or bool(kernel.pads_on_rail(counts))
        return self._any or bool((counts[:, _PADS] + np.uint8(1) < 2).any())

    def may_come_loose(self, counts: NDArray[np.uint8]) -> bool:
        """Whether a triangle that is not loose may be so by counts (n_triangles, 12): `update` says whether it is."""
        if kernel is not None:
            return bool(kernel.may_be_loose(counts, self.top_is_rail, self.loose))
        pads = counts[:, _PADS]
        odd = ((pads == 0) | ((pads == 255) & self.top_is_rail)).any(axis=1)
        odd |= (counts[:, 9] == 0) & ~self.top_is_rail[:, 0]
        return bool((odd & ~self.loose).any())

    def update(self, counts: NDArray[np.uint8], fresh: NDArray[np.bool_], t_mono_ns: int) -> bool:
        """Take in counts (n_triangles, 12); whether `loose` changed.

        fresh (n_triangles,): halves of it came, and both ever did. Found in the first cycle, also where only one half
        of that cycle is newer than the fault.
        """
        bad = self._on_rails(counts) & fresh
        bad |= self._deaf
        self._bad_ns[bad] = t_mono_ns
        loose = bad | (self.loose & (~fresh | (t_mono_ns - self._bad_ns < GOOD_NS)))
        changed = bool((loose != self.loose).any())
        self.loose[:], self._any = loose, bool(loose.any())
        return changed

    def listen(self, fresh: NDArray[np.bool_], changed: NDArray[np.bool_]) -> None:
        """Look for triangles without noise where others have it; changed (n_triangles,): since the look before."""
        self._quiet += fresh
        self._quiet[changed] = 0
        self._deaf = self._noisy & (self._quiet >= DEAF_LOOKS)
        if np.count_nonzero(self._deaf):
            others = self._quiet[self._noisy & ~self._deaf]
            self._deaf &= len(others) > 0 and bool(np.median(others) <= LIVELY_LOOKS)
            self._any |= bool(self._deaf.any())

    def _on_rails(self, counts: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """(n_triangles,) whether the counts (n_triangles, 12) are none of a triangle that is there."""
        rail = counts == 0
        rail |= (counts == 255) & self.top_is_rail
        in_a = rail[:, :_HALF_A].sum(axis=1)
        in_b = rail[:, _HALF_A:].sum(axis=1)
        pad_a, pad_b = rail[:, _PAD_A], rail[:, _PAD_B]
        bad: NDArray[np.bool_] = (in_a == _HALF_A) | (in_b == 12 - _HALF_A)
        bad |= (in_a + in_b >= ON_RAILS) & (pad_a | pad_b)
        if self._rests_at_top:  # a chip that reads 0: its taxel 9 alone is at 0, and all others at 255
            bad |= (counts[:, 9] == 0) & ((counts == 255).sum(axis=1) == 11)
        return bad
