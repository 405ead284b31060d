"""How long the frames of a board wait while others keep the bus busy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ...skin.bus_load import BIT_RATE_HZ, FRAME_BITS

BUSY_S = 2.0 * max(FRAME_BITS) / BIT_RATE_HZ  # longest step between the stamps of frames that follow at once


def bus_waits(
    t_s: Array, interface: NDArray[np.uint8], is_own: NDArray[np.bool_], is_first: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Return how long each frame of a board has waited since the board's first one, and at most before that; (n,), s.

    `t_s`, `interface` (n,): stamp and bus of every frame that was recorded. `is_own`, `is_first` (n,): frames of the
    board, and the first that it sends of its readings. 0 for frames of others.

    A board composes all its frames at once, and cannot send while others do. What others sent between its frames has
    delayed the later ones. A first frame that follows others at once may have been ready as soon as the bus became
    busy; one on a free bus was sent when it was ready.
    """
    since_first_s, before_s = np.zeros(len(t_s)), np.zeros(len(t_s))
    if np.count_nonzero(is_first) < 2:
        return since_first_s, before_s
    on_bus = np.flatnonzero(interface == interface[np.argmax(is_first)])
    on_bus = on_bus[np.argsort(t_s[on_bus], kind="stable")]
    times_s, own, first = t_s[on_bus], is_own[on_bus], is_first[on_bus]
    row = np.arange(len(on_bus))
    steps_s = np.diff(times_s, prepend=times_s[0])
    is_busy = steps_s <= BUSY_S
    of_others_s = np.cumsum(np.where(is_busy & ~own, steps_s, 0.0))
    busy_since = np.maximum.accumulate(np.where(is_busy, 0, row))
    began = np.maximum.accumulate(np.where(first, row, -1))
    # Where the first frame is missing, the last that came is of earlier readings.
    is_recent = own & (began >= 0) & (times_s - times_s[began] < 0.9 * float(np.median(np.diff(times_s[first]))))
    since_first_s[on_bus] = np.where(is_recent, of_others_s - of_others_s[began], 0.0)
    before_s[on_bus] = np.where(is_recent, times_s[began] - times_s[busy_since[began]], 0.0)
    return since_first_s, before_s
