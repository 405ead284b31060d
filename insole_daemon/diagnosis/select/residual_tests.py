"""What a set of terms leaves of the residual, against white noise: is there something that no term describes?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from ...physics.law import Array

SLOW_S = (0.2, 1.0, 5.0)  # windows over which noise averages out and a mismatch does not
LEAST_EXCESS = 0.2  # of the noise's mean square, in one channel: less is noise that is not quite white


@dataclass(frozen=True, slots=True)
class LackOfFit:
    """Mean squares in units of the noise, by channel (c,)."""

    noise: Array  # of the residual's fast part
    excess: Array  # of its slow part, beyond what white noise has there


def lack_of_fit(z: Array, step_s: float, expected: float = 0.0) -> LackOfFit:
    """Of a weighted residual (N, c) in time order.

    The level of the noise comes from differences of neighbouring rows; the excess is the largest, over a few windows,
    of what averages keep beyond that noise, and beyond what of the mean square that is `expected` is slow.
    """
    noise = np.mean(np.diff(z, axis=0) ** 2, axis=0) / 2.0
    excess = np.zeros(z.shape[1])
    for window_s in SLOW_S:
        size = max(round(window_s / step_s), 3)
        slow = uniform_filter1d(z, size, axis=0)
        excess = np.maximum(excess, np.mean(slow**2, axis=0) - 1.5 * noise / size)
    return LackOfFit(noise, np.maximum(excess - np.maximum(expected - noise, 0.0), 0.0))
