"""Encode a triangle's reading as the payloads of its two halves.

Source: robotology/icub-firmware, embot_prot_can_skin_periodic.cpp 78–111.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..skin.identifiers import TAG_A, TAG_B


def halves(counts: NDArray[np.uint8], status: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Return payloads (…, 2, 8), half A then half B, of counts (…, 12) and status words (…)."""
    data = np.empty((*status.shape, 2, 8), np.uint8)
    data[..., 0, 0] = TAG_A
    data[..., 0, 1:] = counts[..., :7]
    data[..., 1, 0] = TAG_B
    data[..., 1, 1:6] = counts[..., 7:]
    data[..., 1, 6] = status >> 8
    data[..., 1, 7] = status & 0xFF
    return data
