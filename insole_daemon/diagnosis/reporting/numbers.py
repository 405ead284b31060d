"""Tables for a reviewer: parameters, and effects that the recordings cannot identify."""

from __future__ import annotations

import numpy as np

from ...report import page
from ..finding import Quantity
from ..outcome import Outcome

LOOPS = ("hysteresis", "creep", "viscoelasticity")


def parameters(diagnosis: Outcome) -> str:
    """Return the table of the parameters of every finding, with standard deviations."""
    rows = [
        (finding.effect, name, _values(quantity), quantity.unit)
        for finding in diagnosis.findings
        for name, quantity in finding.parameters.items()
    ]
    if not rows:
        return page.paragraph("The findings have no parameters.")
    note = "± is one standard deviation, from the covariance of the regression and 5 % for the misfit of the law."
    if any(finding.effect in LOOPS for finding in diagnosis.findings):
        note += " amplitude_fraction: half the peak-to-peak of what the effect adds, over the span of the load."
    return page.table(("effect", "parameter", "value ± σ", "unit"), rows, (0, 1, 2, 3)) + page.paragraph(note)


def limits(diagnosis: Outcome) -> str:
    """Return the table of effects that these recordings cannot identify, and what to record instead."""
    rows = [(limit["effect"], limit["why"], limit["record_instead"]) for limit in diagnosis.not_identifiable]
    return page.table(("effect", "why it cannot be identified", "record instead"), rows, range(3))


def _values(quantity: Quantity) -> str:
    pairs = zip(np.ravel(quantity.value), np.ravel(quantity.std), strict=True)
    return ", ".join(f"{value:.4g} ± {std:.2g}" for value, std in pairs)
