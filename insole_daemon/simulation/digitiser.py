"""What the firmware makes of a triangle's twelve 16-bit words: the 8-bit counts, their flags, the two halves.

    value  = raw16 − baseline16
    count  = 255                     where value ≤ −((255 − no_load) << shift)
             0                       where value ≥ no_load << shift
             no_load − (value >> shift)   elsewhere; >> is arithmetic, a floor
    flag   = value ≤ −2·((255 − no_load) << shift)  or  value ≥ 2·(no_load << shift)

Source: robotology/icub-firmware, embot_app_application_theSkin.cpp 439–467 (MTB4, 32-bit arithmetic) and
embot_prot_can_skin_periodic.cpp 78–111. The drift compensation of skin types 0 and 8, which subtracts
pad 6's change · gain_k / 128 from taxel k, is left out: the emulated pads do not change with temperature.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..skin.identifiers import ERROR_NO_ACK, ERROR_NOT_CONNECTED, TAG_A, TAG_B

OPEN_LINE = 0xFFFF  # every word of a triangle that is not there: a pulled-up data line

_FLAG_BITS = (1 << np.arange(4, 16)).astype(np.int64)  # out-of-range flag of taxel k is bit 4 + k


def digitise(
    raw16: NDArray[np.int64], baseline16: NDArray[np.int64], no_load: int, shift: NDArray[np.int64]
) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """Counts (…, 12) and status words (…) of the words `raw16` (…, 12).

    `baseline16` and `shift` (broadcast against `raw16`; a shift is a triangle's, so (n_triangles, 1)).
    """
    value = raw16 - baseline16
    top = no_load << shift
    bottom = (no_load - 255) << shift
    # Within the two pins the formula cannot leave 0..255, so clamping is the same as the firmware's rules.
    counts = np.clip(no_load - (value >> shift), 0, 255).astype(np.uint8)
    flags = (value <= 2 * bottom) | (value >= 2 * top)
    status = np.where((raw16 == OPEN_LINE).all(axis=-1), ERROR_NOT_CONNECTED, 0)
    status |= np.where(((raw16 == 0) & (baseline16 != 0)).any(axis=-1), ERROR_NO_ACK, 0)
    if flags.any():
        status |= flags @ _FLAG_BITS
    return counts, status.astype(np.uint16)


def low_bytes(raw16: NDArray[np.int64]) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """What stands for counts (…, 12) and status words (…) in the raw test mode, skin type 7."""
    return (raw16 & 0xFF).astype(np.uint8), np.zeros(raw16.shape[:-1], np.uint16)


def halves(counts: NDArray[np.uint8], status: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Payloads (…, 2, 8), half A then half B, of counts (…, 12) and status words (…)."""
    data = np.empty((*status.shape, 2, 8), np.uint8)
    data[..., 0, 0] = TAG_A
    data[..., 0, 1:] = counts[..., :7]
    data[..., 1, 0] = TAG_B
    data[..., 1, 1:6] = counts[..., 7:]
    data[..., 1, 6] = status >> 8
    data[..., 1, 7] = status & 0xFF
    return data
