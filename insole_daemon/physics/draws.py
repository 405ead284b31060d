"""Every random draw of physics and simulator: one seed, and for each thing that is drawn a stream of its own.

    stream       key                    what is drawn from it
    SENSORS      board                  codes at rest, sensitivities, rate and phase of the board's clock
    NOISE        board, luck            the noise of every reading, in the order of readings
    CONVERTERS   board                  phases of the converters
    FAULT        board, place           on which ticks the fault at that place of the list strikes
    JITTER       board                  by how much its samples are late
    LOSSES       board                  which of its frames never come
    CURVES       board                  the true static curves of its taxels
    CLOCK                               offset and rate of the reference's clock
    INSTRUMENT   foot (0, 1), luck      noise and drift of the reference, column by column
    STRIDES                             what varies from stride to stride
    CONCEALED                           where and how strong an effect is that a demo conceals

Boards are named by address. The luck is that of a trial: another scenario on the same insole. So nothing that is added,
left out or asked for in another order changes what is drawn for the rest.

The bits are those of PCG64, seeded through SeedSequence with the stream and its key as spawn_key; numpy promises both
for ever, but not what its Generator makes of them (NEP 19), which also asks the C library. So uniform and normal
numbers are made here, of operations that IEEE 754 rounds exactly.
"""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from .portable import ln, sin_turns

_AT_ONCE = 2048  # pairs of normal numbers that are worked out together


class Drawn(IntEnum):
    """See the module's table."""

    SENSORS = 0
    NOISE = 1
    CONVERTERS = 2
    FAULT = 3
    JITTER = 4
    LOSSES = 5
    CURVES = 6
    CLOCK = 7
    INSTRUMENT = 8
    STRIDES = 9
    CONCEALED = 10


class Draws:
    """One stream, from its beginning on; how many numbers are asked for at once makes no difference to them."""

    def __init__(self, seed: int, stream: Drawn, *key: int) -> None:
        self._bits = np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(stream, *key)))
        self._ready = np.empty(0)  # normal numbers

    def uniform(self, n: int) -> NDArray[np.float64]:
        """(n,) from 0 up to, not including, 1."""
        numbers = (self._bits.random_raw(n) >> np.uint64(11)).astype(np.float64) * 2.0**-53
        return numbers

    def normal(self, *shape: int) -> NDArray[np.float64]:
        """`shape`: of mean 0 and variance 1."""
        n = math.prod(shape)
        parts = [self._ready]
        while sum(map(len, parts)) < n:
            parts.append(self._pairs())
        numbers = np.concatenate(parts)
        self._ready = numbers[n:]
        return numbers[:n].reshape(shape)

    def _pairs(self) -> NDArray[np.float64]:
        """(2 · _AT_ONCE,) after Box and Muller 1958."""
        even, turns = self.uniform(2 * _AT_ONCE).reshape(2, _AT_ONCE)
        radius = np.sqrt(-2.0 * ln(1.0 - even))
        return np.concatenate([radius * sin_turns(turns), radius * sin_turns(turns + 0.25)])
