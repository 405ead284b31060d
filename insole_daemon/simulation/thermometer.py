"""The thermometer of an MTB4, an SI7051: its commands and its frames.

    to               payload        effect
    0x200 | address  39 01          configured
                     3A SECONDS     a reading every so many seconds, 0 stops

    0x300 | address << 4 | 0xE      01, int16 in 0.1 °C, int16 reserved; little endian

Source: TSD-ICUBUNIT-canprotocol 3.3.4. The conversion time of 7 ms is neglected.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from ..skin.identifiers import CLASS_LEGACY_SKIN, TYPE_THERMOMETER, skin_id

_MASK = 1


class Thermometer:
    """State of the thermometer: whether it is on, and when it reads next."""

    def __init__(self) -> None:
        self._configured = False
        self._period_ns: int | None = None
        self._next_ns = 0

    def configure(self, mask: int) -> None:
        """Select sensors by `mask`; bit 0 is the only one that exists."""
        self._configured = bool(mask & _MASK)

    def start(self, seconds: int, t_ns: int) -> None:
        """Read every `seconds` from `t_ns` on; 0 stops."""
        self._period_ns = seconds * 1_000_000_000 if seconds and self._configured else None
        self._next_ns = t_ns + (self._period_ns or 0)

    def ticks(self, until_ns: int) -> NDArray[np.int64]:
        """Return the times of readings before `until_ns` that no earlier call returned."""
        if self._period_ns is None:
            return np.empty(0, np.int64)
        times_ns = np.arange(self._next_ns, until_ns, self._period_ns)
        self._next_ns += len(times_ns) * self._period_ns
        return times_ns


def thermometer_frame(address: int, temperature_c: float) -> tuple[int, bytes]:
    """Return identifier and payload of a reading."""
    payload = struct.pack("<Bhh", _MASK, round(temperature_c * 10), 0)
    return skin_id(address, TYPE_THERMOMETER, CLASS_LEGACY_SKIN), payload
