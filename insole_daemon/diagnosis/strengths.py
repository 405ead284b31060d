"""Strengths: the same physics acts on each taxel by more or less than on the others.

Covers are not equally thick, and materials not equally cured: a hypothesis has one strength for all readings, and what
they scatter about it would stand in what it leaves, a hundredth of the mismatch for a tenth of the strength. To first
order a reading whose strength is s instead of 1 says (s − 1)·C'(q)·(q − q₀) more, q₀ the load after the other effects
alone: one column a reading has a share of. Where and when an effect acts is no matter of strength: those without
`scatters` have none.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..physics.law import Array
from .candidate import Candidate
from .fit import Fitted, Hypothesis, within

_RANK = 1e-6  # relative size of an answer that others already are


def freed(hypothesis: Hypothesis, fitted: Fitted) -> Fitted:
    """`fitted` with a strength of its own of each effect in each reading, to first order."""
    scattering = [each for each in fitted.candidates if each.scatters]
    if not scattering:
        return fitted
    moved = _moved(hypothesis, fitted, scattering)
    slope = hypothesis.slope(fitted)
    if moved.shape[1] == 1:  # mixtures of taxels under one load: the strongest is their common curve
        slope = slope[:, [int(np.argmax(np.sum(slope**2, axis=0)))]]
    own = (slope[..., None] * moved).swapaxes(0, 1)
    design = np.concatenate([fitted.design, own], axis=2)
    return hypothesis.explained(fitted.theta, fitted.rows, fitted.effective_pa, design)


def amounts(hypothesis: Hypothesis, fitted: Fitted) -> Array:
    """(c, r) RMS of what each candidate does to each reading and no curve could, less than 0 where it does it reversed.

    `fitted` has no strengths of its own: the load is moved as much for all, and each reading answers by what it does.
    """
    acting = [each for each in fitted.candidates if each.act is not None]
    basis = np.linalg.qr(fitted.design)[0]
    moved = hypothesis.slope(fitted)[..., None] * _moved(hypothesis, fitted, acting)
    for each in np.moveaxis(moved, 2, 0):
        each -= within(basis, each)
    own, said = np.einsum("nrc,nrd->rcd", moved, moved), np.einsum("nrc,nr->rc", moved, fitted.residual)
    strength = 1.0 + np.einsum("rcd,rd->rc", np.linalg.pinv(own, rcond=_RANK), said)  # (r, c)
    acts = strength * np.sqrt(np.mean(moved**2, axis=0))
    brought = hypothesis.brought_by(fitted)
    found: Array = np.stack([
        acts[:, acting.index(each)] if each.act is not None else np.std(brought[each.word], axis=0)
        for each in fitted.candidates
    ])  # fmt: skip
    return found


def _moved(hypothesis: Hypothesis, fitted: Fitted, effects: Sequence[Candidate]) -> Array:
    """(n, m, c) by how much each of the effects moves the load, Pa."""
    found = []
    n_clock = fitted.clocks().size
    for left_out in effects:
        kept = [(c, own) for c, own in zip(fitted.candidates, fitted.values(), strict=True) if c is not left_out]
        theta = np.concatenate([fitted.theta[:n_clock], *(own for _, own in kept)])
        others = Hypothesis(hypothesis.evidence, [c for c, _ in kept])
        found.append(fitted.effective_pa - others.effective_pa(theta))
    return np.stack(found, axis=-1) if found else np.empty((*fitted.effective_pa.shape, 0))
