"""Detection of loose triangles, from the counts alone.

The firmware sends these counts for a disconnected triangle (icub-firmware, embot_app_application_theSkin.cpp and
mtb3/main_V3.c; long stretches of the public insole recordings have the first line):

    taxels 0–8, 10, 11    taxel 9    when
    0                     255        MTB4, skin type 0: an open data line
    0                     0          MTB4, other types; MTB3, baseline in the upper half
    255                   255        MTB3, baseline in the lower half
    255                   0          MTB4, skin type 0: a chip that reads 0

Recordings also contain mixtures of 0 and 255 while a contact flickers. In all cases the *thermal pads* read the end of
the range: pads 6 and 10 change by some tens of counts at the most, so no load brings them there. A full load on ten
taxels is therefore never taken for a loose triangle.

A triangle that was loose when its board was zeroed sends the same twelve counts for ever, and so does a frozen one. The
noise of the other triangles distinguishes it from a triangle at rest.

With a no-load near 255 a triangle at rest reads that end of the range itself. The count 255 is then ignored, and an
open triangle of an MTB3 with its baseline in the lower half is detected only by its missing noise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...compiled import kernel
from ..geometry import THERMAL_PADS
from .places import Places
from .rest import TOP_MARGIN

GOOD_NS = 3_000_000_000  # how long it must be good before it is used again, as contacts flicker; more than DEAF_LOOKS
ON_RAILS = 10  # of 12; contacts that flicker leave one or two in between
DEAF_LOOKS = 60  # without one change among twelve taxels: at a noise of 0.9 counts not even 3 in a row occur
LIVELY_LOOKS = 2  # checks in which the median triangle changes, if the counts show noise
NOISY_SHIFT = 4  # up to this shift the noise of some eight codes reaches the counts at rest

_PAD_A, _PAD_B = THERMAL_PADS
_PADS = slice(_PAD_A, None, _PAD_B - _PAD_A)
_HALF_A = 7  # taxels 0–6 come in half A, 7–11 in half B


class LooseTriangles:
    """The loose triangles of one foot, cycle by cycle."""

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
        self._quiet = np.zeros(n, np.int64)  # checks without a change

    def must_update(self, counts: NDArray[np.uint8]) -> bool:
        """Return whether counts (n_triangles, 12) may change a state: a pad at its range's end, or a loose triangle."""
        if kernel is not None:
            return self._any or bool(kernel.pads_on_rail(counts))
        return self._any or bool((counts[:, _PADS] + np.uint8(1) < 2).any())

    def may_come_loose(self, counts: NDArray[np.uint8]) -> bool:
        """Return whether counts (n_triangles, 12) hint at a newly loose triangle; `update` decides."""
        if kernel is not None:
            return bool(kernel.may_be_loose(counts, self.top_is_rail, self.loose))
        pads = counts[:, _PADS]
        odd = ((pads == 0) | ((pads == 255) & self.top_is_rail)).any(axis=1)
        odd |= (counts[:, 9] == 0) & ~self.top_is_rail[:, 0]
        return bool((odd & ~self.loose).any())

    def update(self, counts: NDArray[np.uint8], fresh: NDArray[np.bool_], t_mono_ns: int) -> bool:
        """Process counts (n_triangles, 12) and return whether `loose` changed.

        fresh (n_triangles,): a half arrived, and both have arrived before. A loose triangle is detected in its first
        cycle, also if only one half of that cycle is newer than the fault.
        """
        bad = self._on_rails(counts) & fresh
        bad |= self._deaf
        self._bad_ns[bad] = t_mono_ns
        loose = bad | (self.loose & (~fresh | (t_mono_ns - self._bad_ns < GOOD_NS)))
        changed = bool((loose != self.loose).any())
        self.loose[:], self._any = loose, bool(loose.any())
        return changed

    def listen(self, fresh: NDArray[np.bool_], changed: NDArray[np.bool_]) -> None:
        """Detect triangles without noise while others have noise; changed (n_triangles,): since the check before."""
        self._quiet += fresh
        self._quiet[changed] = 0
        self._deaf = self._noisy & (self._quiet >= DEAF_LOOKS)
        if np.count_nonzero(self._deaf):
            checks_of_others = self._quiet[self._noisy & ~self._deaf]
            self._deaf &= len(checks_of_others) > 0 and bool(np.median(checks_of_others) <= LIVELY_LOOKS)
            self._any |= bool(self._deaf.any())

    def _on_rails(self, counts: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return whether counts (n_triangles, 12) cannot be those of a connected triangle, (n_triangles,)."""
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
