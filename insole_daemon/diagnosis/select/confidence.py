"""The probability that a finding is there, from how much worse the best set without its word is.

One logistic regression on the margin; `benchmarks/diagnosis/confidence.py` fits it.
"""

from __future__ import annotations

import math

CLOSE = 0.5  # of the least gain of an effect: a set with fewer columns that is no worse than that is preferred
SAME = 0.15  # of the least gain: sets that are no worse than that are alternatives
COEFFICIENTS = (1.0, 1.5, -1.0)  # of `features`; a guess until they are fitted
MOST_MARGIN = 100.0  # more says no more
LEAST, MOST = 0.02, 0.98  # what so few cases can tell


def features(margin: float, has_alternative: bool) -> tuple[float, float, float]:
    """What the logistic regression is on: 1, the logarithm of the margin, and whether another word does as well.

    `margin` is in units of the least gain that an effect needs.
    """
    return 1.0, math.log(min(max(margin, 0.0), MOST_MARGIN) + 0.2), float(has_alternative)


def confidence(margin: float, has_alternative: bool) -> float:
    """Of a finding with this margin."""
    x = sum(c * f for c, f in zip(COEFFICIENTS, features(margin, has_alternative), strict=True))
    return min(max(1.0 / (1.0 + math.exp(-x)), LEAST), MOST)
