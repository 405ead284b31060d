"""A number in every half: which tick of its board it is of, in the two lowest bits of its counts.

Seven counts of a half A hold 14 bits, five of a half B 10; that is the noise of a sensor to whoever reads pressures.
A half with a count near the ends of the range (open, shorted, saturated) is left as it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

A_BITS, B_BITS = 14, 10
NONE = -1
_LOW, _HIGH = 4, 252  # counts that carry a number


def write(halves: NDArray[np.uint8], number: int) -> bool:
    """Write `number` into the counts (7,) or (5,) of one half, in place; whether it carries it now."""
    if halves.min() < _LOW or halves.max() >= _HIGH:
        return False
    digits = number >> 2 * np.arange(len(halves)) & 3
    halves[:] = (halves & 0xFC) | digits
    return True


def read(counts: NDArray[np.uint8]) -> NDArray[np.int64]:
    """(…, n) numbers from counts (…, n, 7) or (…, n, 5); NONE where there is none."""
    digits = (counts & 3).astype(np.int64)
    numbers = (digits << 2 * np.arange(counts.shape[-1])).sum(axis=-1)
    return np.where((counts < _LOW).any(axis=-1) | (counts >= _HIGH).any(axis=-1), NONE, numbers)
