"""Parts of the penalties of sets of candidates that do not depend on what is observed of the load."""

from __future__ import annotations

import numpy as np

from ..model.regression import PlacedTerm, Regression

EARLY = 4.0  # additional least gains if readings come before their load, the least plausible hypothesis
# The law of another memory describes at most half of a misfit, and so does a delay or lag of a walk, but for that of a
# viscoelasticity: UNDESCRIBED times what the set leaves beyond the noise, of which LEAST_UNDESCRIBED is uncertain.
UNDESCRIBED, LEAST_UNDESCRIBED = 1.0, 0.1
# Fraction of a static effect's mean square that another one at the same place may explain: a changed curve has one
# cause, which no static word describes exactly. WITHIN_PRIORS makes it a tenth.
MISFIT_OF_STATIC = 0.025
ODDS = 8.0  # penalty for the choice of the word among all terms


def search_penalty(candidate: PlacedTerm, n_columns: float, n_rows: int, least_gain: float) -> float:
    """Return k ln(n) + 2 ln(m) + ODDS for k free columns, n rows, and m searched places and settings.

    A companion counts as half a column.
    """
    searched = candidate.n_places * (1 + 4 * len(candidate.term.refine))
    early = EARLY * least_gain if candidate.settings[0].get("early_s") else 0.0
    n = n_columns + 0.5 * len(candidate.companions)
    return float(early + ODDS + n * np.log(n_rows) + 2 * np.log(searched))


def most_misfit(design: Regression, left: float) -> float:
    """Return the largest misfit of a law that another one describes, if the squared residual `left` remains."""
    return UNDESCRIBED * max(left - design.noise, LEAST_UNDESCRIBED * design.noise)
