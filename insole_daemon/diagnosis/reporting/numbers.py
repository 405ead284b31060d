"""For a reviewer: parameters, and what the recordings cannot tell."""

from __future__ import annotations

import numpy as np

from ...report import page
from ..finding import Quantity
from ..outcome import Outcome

LOOPS = ("hysteresis", "creep", "viscoelasticity")


def parameters(diagnosis: Outcome) -> str:
    """Of every finding, with standard deviations."""
    rows = [
        (each.effect, name, _values(quantity), quantity.unit)
        for each in diagnosis.findings
        for name, quantity in each.parameters.items()
    ]
    if not rows:
        return page.paragraph("There are no parameters to tell.")
    note = "± is one standard deviation (jackknife over the folds: it sees what the family misses, too)."
    if any(each.effect in LOOPS for each in diagnosis.findings):
        note += " amplitude_fraction: half the peak-to-peak of what the effect adds, over the span of the load."
    return page.table(("effect", "parameter", "value ± σ", "unit"), rows, (0, 1, 2, 3)) + page.paragraph(note)


def limits(diagnosis: Outcome) -> str:
    """What these recordings cannot tell, and what to record instead."""
    rows = [(each["effect"], each["why"], each["record_instead"]) for each in diagnosis.not_identifiable]
    return page.table(("effect", "why it cannot be told", "record instead"), rows, range(3))


def _values(quantity: Quantity) -> str:
    pairs = zip(np.ravel(quantity.value), np.ravel(quantity.std), strict=True)
    return ", ".join(f"{value:.4g} ± {std:.2g}" for value, std in pairs)
