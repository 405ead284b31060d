"""What is left of walks as newtons and newton metres."""

from __future__ import annotations

import numpy as np

from ...physics.law import Array
from .evidence import Evidence


def rms(evidence: Evidence, left: Array, channel: int = 0) -> float:
    """RMS of `left` (n, 3), in units of the noise, as N or N·m of sums that were not smoothed, over all walks."""
    square = [
        float(np.mean((left[rows, channel] * part.noise[channel]) ** 2)) + _taken(evidence, i, channel)
        for i, part in enumerate(evidence.parts)
        if (rows := evidence.judged & (evidence.of_part == i)).any()
    ]
    return float(np.sqrt(np.mean(square)))


def floor(evidence: Evidence, channel: int = 0) -> float:
    """What the noise of both sides comes to, unsmoothed."""
    squares = [p.noise[channel] ** 2 + _taken(evidence, i, channel) for i, p in enumerate(evidence.parts)]
    return float(np.sqrt(np.mean(squares)))


def _taken(evidence: Evidence, i: int, channel: int) -> float:
    """What the kernel took away of the noise's square."""
    part = evidence.parts[i]
    raw = np.hypot(part.walk.noise[channel], part.walk.shoe.noise[channel])
    return max(float(raw**2 - part.noise[channel] ** 2), 0.0)
