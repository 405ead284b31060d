"""Draw all random numbers of physics and simulator: one seed, and an independent stream for each purpose.

    stream       key                    draws
    SENSORS      board                  unloaded codes, sensitivities, rate and phase of the board's clock
    NOISE        board, noise_key       noise of every reading, in the order of readings
    CONVERTERS   board                  phases of the converters
    FAULT        board, place           ticks at which the fault with that index strikes
    JITTER       board                  delays of its samples
    LOSSES       board                  lost frames
    CURVES       board                  true static curves of its taxels
    CLOCK                               offset and rate of the reference's clock
    INSTRUMENT   foot (0, 1), noise_key noise and drift of the reference, column by column
    STRIDES                             variation from stride to stride
    CONCEALED                           place and strength of the effect that a demo conceals

Boards are identified by address; `noise_key` identifies the trial, so another trial uses the same insole. Adding,
omitting or reordering draws of one stream does not change any other stream.

The bits are those of PCG64, seeded through SeedSequence with stream and key as spawn_key. numpy guarantees both, but
not its Generator's distributions (NEP 19), which also call the C library. Uniform and normal numbers are therefore
computed here, with operations that IEEE 754 rounds exactly.
"""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from .portable import ln, sin_turns

_AT_ONCE = 2048  # pairs of normal numbers per batch


class Drawn(IntEnum):
    """Streams; see the table of the module."""

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
    """One stream; the size of the requests does not change the numbers."""

    def __init__(self, seed: int, stream: Drawn, *key: int) -> None:
        self._bits = np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(stream, *key)))
        self._ready = np.empty(0)  # normal numbers

    def uniform(self, n: int) -> NDArray[np.float64]:
        """Return (n,) uniform numbers in [0, 1)."""
        numbers = (self._bits.random_raw(n) >> np.uint64(11)).astype(np.float64) * 2.0**-53
        return numbers

    def normal(self, *shape: int) -> NDArray[np.float64]:
        """Return normal numbers of mean 0 and variance 1, in the given shape."""
        n = math.prod(shape)
        parts = [self._ready]
        while sum(map(len, parts)) < n:
            parts.append(self._pairs())
        numbers = np.concatenate(parts)
        self._ready = numbers[n:]
        return numbers[:n].reshape(shape)

    def _pairs(self) -> NDArray[np.float64]:
        """Return (2 · _AT_ONCE,) normal numbers by Box and Muller 1958."""
        even, turns = self.uniform(2 * _AT_ONCE).reshape(2, _AT_ONCE)
        radius = np.sqrt(-2.0 * ln(1.0 - even))
        return np.concatenate([radius * sin_turns(turns), radius * sin_turns(turns + 0.25)])
