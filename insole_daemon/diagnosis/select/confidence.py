"""Confidence: the probability that a finding, or one of its alternatives, is really there.

A logistic regression on four features: the margin, the loss of score of the best set without the finding's word; the
fraction of the mismatch that all findings together leave; the number of findings, because a model that lacks the right
law gets many terms in its place; and whether it is an effect of single triangles, which a part of another effect may
look like. `docs/evidence/diagnosis.md` says on which cases the coefficients were fitted;
`benchmarks/diagnosis/confidence.py` fits them to cases of the blind benchmark.
"""

from __future__ import annotations

import math

from ...physics.effect import Where

CLOSE_SCORE = 0.5  # times the least gain: a set of preferred terms may score this much less (SubsetSearch.simplify)
EQUAL_SCORE = 0.15  # times the least gain: sets that score this much less are alternatives
COEFFICIENTS = (2.90, 0.37, -4.30, -2.20, -1.77)  # of the `features`
# Of an `unknown`: a part of them is a known effect that the search did not find. Beside other findings more are.
UNKNOWN, UNKNOWN_BESIDE_OTHERS = 0.85, 0.4
MOST_MARGIN = 100.0  # larger margins are no more certain
# Bounds of the confidence: the fit has too few cases for more. Of 12 opened findings with less than 0.2, 8 were right.
LEAST, MOST = 0.2, 0.98
LEAST_MEAN = 0.4  # mean confidence of the terms of a walk: at or below it, one unknown effect is reported instead


def is_of_triangles(effect: str, where: Where) -> bool:
    """Return whether a finding is an effect of single triangles; a swap of two is one of the layout."""
    return where.scope == "triangle" and effect != "swapped_triangles"


def features(
    margin: float, residual_fraction: float, n_findings: int, of_triangles: bool
) -> tuple[float, float, float, float, float]:
    """Return the features: 1, the logarithm of the margin, the square root of the residual fraction, and two more.

    `margin`: in units of the least gain of an effect. `residual_fraction`: 0 to 1, `HeldoutErrors.residual_fraction`.
    `n_findings`: of the recording, of which the logarithm is a feature. `of_triangles`: see `is_of_triangles`.
    """
    margin = min(max(margin, 0.0), MOST_MARGIN)
    return 1.0, math.log(margin + 0.2), math.sqrt(residual_fraction), math.log(n_findings), float(of_triangles)


def confidence(margin: float, residual_fraction: float, n_findings: int, of_triangles: bool = False) -> float:
    """Return the confidence, LEAST to MOST, of a finding; the arguments are those of `features`."""
    values = features(margin, residual_fraction, n_findings, of_triangles)
    x = sum(c * f for c, f in zip(COEFFICIENTS, values, strict=True))
    return min(max(1.0 / (1.0 + math.exp(-x)), LEAST), MOST)
