"""Confidence: the probability that a finding, or one of its alternatives, is really there.

A logistic regression on two features: the margin, the loss of score of the best set without the finding's word, and the
fraction of the mismatch that all findings together leave. `benchmarks/diagnosis/confidence.py` fits its coefficients.
"""

from __future__ import annotations

import math

CLOSE_SCORE = 0.5  # times the least gain: a set of preferred terms may score this much less (SubsetSearch.simplify)
EQUAL_SCORE = 0.15  # times the least gain: sets that score this much less are alternatives
COEFFICIENTS = (0.96, 0.39, -1.13)  # of the three `features`
MOST_MARGIN = 100.0  # larger margins are no more certain
LEAST, MOST = 0.02, 0.98  # bounds of the confidence: the fit has too few cases for more


def features(margin: float, residual_fraction: float) -> tuple[float, float, float]:
    """Return the features: 1, the logarithm of the margin, and the square root of the residual fraction.

    `margin`: in units of the least gain of an effect. `residual_fraction`: 0 to 1, `HeldoutErrors.residual_fraction`.
    """
    return 1.0, math.log(min(max(margin, 0.0), MOST_MARGIN) + 0.2), math.sqrt(residual_fraction)


def confidence(margin: float, residual_fraction: float) -> float:
    """Return the confidence, 0.02 to 0.98, of a finding; the arguments are those of `features`."""
    x = sum(c * f for c, f in zip(COEFFICIENTS, features(margin, residual_fraction), strict=True))
    return min(max(1.0 / (1.0 + math.exp(-x)), LEAST), MOST)
