"""What of an explanation a model carries over to loads it has not seen.

A finding is judged on short blocks, between which the load is much the same. A model is for another day: what it takes
over of something that nothing known explains, and how freely its curves may bend, is judged on whole stretches of the
recording, each foretold from the others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..physics.law import Array
from .deciding import Decided
from .fit import Evidence, Fitted, Hypothesis
from .groups import Named
from .naming import folds

N_STRETCHES = 4
HELPS = 0.5  # of what the static model leaves above the noise, that physics may leave to be taken over, not asserted
BENDS = 0.7  # of what one cubic leaves above the noise, that a curve of pieces may leave to be taken


def carried(named: Named, decided: Decided) -> Decided:
    """What is said of a group, with the set of effects that the model has as the best: all that is asserted.

    Where nothing is, what lasts of the set that comes nearest, if it helps: a drift has no say in what it has not seen.
    """
    naming, evidence = named.naming, named.group.evidence
    if not decided.unknown:
        return decided
    lasting = {each.word for each in naming.best.fitted.candidates if not each.own_columns}
    nearest = next((each for each in naming.tried if set(each.words) == lasting), naming.null)
    without, with_it = (
        foretold(Hypothesis(evidence, each.fitted.candidates), each.fitted.theta) - naming.floor
        for each in (naming.null, nearest)
    )
    best = nearest if with_it < HELPS * without else naming.null
    return Decided(
        best,
        alternatives=dict.fromkeys(best.words, ()),
        unknown=True,
        confidence=dict.fromkeys(best.words, 0.0),
        alone=dict.fromkeys(best.words, naming.null),
    )


def bends(evidence: Evidence, fitted: Fitted, floor: float) -> bool:
    """Whether curves of pieces foretell stretches clearly better than one cubic for each taxel; `floor`: of noise."""
    plain, pieces = (
        foretold(Hypothesis(evidence, fitted.candidates, plain), fitted.theta) - floor for plain in (True, False)
    )
    return pieces < BENDS * plain


def foretold(hypothesis: Hypothesis, theta: Array) -> float:
    """Mean square of what is left of stretches, each foretold by curves fitted to the others, with the physics θ."""
    evidence = hypothesis.evidence
    # What drifts is known only between moments at which it was seen.
    drifts = any(each.own_columns for each in hypothesis.candidates)
    stretch = folds(evidence) if drifts else _stretches(evidence)
    total = 0.0
    for i in np.unique(stretch):
        out = stretch == i
        total += float(np.sum(hypothesis.fit(theta, ~out, most_steps=0).residual[out] ** 2))
    return total / evidence.y.size


def _stretches(evidence: Evidence) -> NDArray[np.intp]:
    """(n,) in which of N_STRETCHES of its recording a row is."""
    return np.concatenate(
        [np.minimum(np.arange(n := len(each.first)) * N_STRETCHES // n, N_STRETCHES - 1) for each in evidence.observed]
    )
