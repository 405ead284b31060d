"""Strengths: the same physics acts on each taxel by more or less than on the others.

Covers are not equally thick, and materials not equally cured: a hypothesis has one strength for all readings, and what
they scatter about it would stand in what it leaves, a hundredth of the mismatch for a tenth of the strength. To first
order a reading whose strength is s instead of 1 says (s − 1)·C'(q)·(q − q₀) more, q₀ the load after the other effects
alone: one column a reading has a share of. Where and when an effect acts is no matter of strength: those without
`scatters` have none.
"""

from __future__ import annotations

import numpy as np

from ..physics.law import Array
from .fit import Fitted, Hypothesis


def freed(hypothesis: Hypothesis, fitted: Fitted) -> Fitted:
    """`fitted` with a strength of its own of each effect in each reading, to first order."""
    moved = _moved(hypothesis, fitted)
    if not moved.size:
        return fitted
    slope = hypothesis.slope(fitted)
    if moved.shape[1] == 1:  # mixtures of taxels under one load: the strongest is their common curve
        slope = slope[:, [int(np.argmax(np.sum(slope**2, axis=0)))]]
    own = (slope[..., None] * moved).swapaxes(0, 1)
    design = np.concatenate([fitted.design, own], axis=2)
    return hypothesis.explained(fitted.theta, fitted.rows, fitted.effective_pa, design)


def _moved(hypothesis: Hypothesis, fitted: Fitted) -> Array:
    """(n, m, c) by how much each effect that scatters moves the load, Pa."""
    found = []
    n_clock = fitted.clocks().size
    for left_out in fitted.candidates:
        if left_out.scatters:
            kept = [(c, own) for c, own in zip(fitted.candidates, fitted.values(), strict=True) if c is not left_out]
            theta = np.concatenate([fitted.theta[:n_clock], *(own for _, own in kept)])
            others = Hypothesis(hypothesis.evidence, [c for c, _ in kept])
            found.append(fitted.effective_pa - others.effective_pa(theta))
    return np.stack(found, axis=-1) if found else np.empty((*fitted.effective_pa.shape, 0))
