"""The probability that a finding is there.

From how much worse the best set without its word is, and from how much all findings leave unexplained. One logistic
regression; `benchmarks/diagnosis/confidence.py` fits it.
"""

from __future__ import annotations

import math

CLOSE = 0.5  # of the least gain of an effect: a set with fewer columns that is no worse than that is preferred
SAME = 0.15  # of the least gain: sets that are no worse than that are alternatives
COEFFICIENTS = (0.96, 0.39, -1.13)  # of `features`
MOST_MARGIN = 100.0  # more says no more
LEAST, MOST = 0.02, 0.98  # what so few cases can tell


def features(margin: float, left_share: float) -> tuple[float, float, float]:
    """What the logistic regression is on: 1, the logarithm of the margin, and the root of the share that is left.

    `margin` is in units of the least gain that an effect needs.
    """
    return 1.0, math.log(min(max(margin, 0.0), MOST_MARGIN) + 0.2), math.sqrt(left_share)


def confidence(margin: float, left_share: float) -> float:
    """Of a finding with this margin, where all findings leave this share of the mismatch."""
    x = sum(c * f for c, f in zip(COEFFICIENTS, features(margin, left_share), strict=True))
    return min(max(1.0 / (1.0 + math.exp(-x)), LEAST), MOST)
