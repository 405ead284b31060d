"""Recordings that contradict each other: an effect that some of them show and others do not.

All recordings are explained together, and what one of them does otherwise bends the explanation of all. So where a
recording keeps more than its noise, each effect is taken out of each recording in turn: an exception is worth its
price when held-out blocks are then predicted better by as much as one more effect has to give. Where that mends
nothing, every recording is searched by itself, and what they name is put together again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..physics.law import Array
from .candidate import Candidate
from .fit import Evidence, Fitted, Hypothesis
from .floor import noise_of_blocks
from .groups import LEAST_EXCESS, Named
from .naming import MOST_EFFECTS, N_FOLDS, Naming, Tried, folds, heldout, left, name, worth

UNEXPLAINED = 0.25  # of the mismatch, that the recordings together leave: each is asked by itself


@dataclass(frozen=True, slots=True, eq=False)
class Foretold:
    """One recording by what only the others know of the physics: RMS of a reading, in units of its noise."""

    recording: str
    before: float  # by the static curves alone
    after: float  # with the effects as fitted to the other recordings


def agreed(named: Named, candidates: Mapping[str, Candidate], deadline: float) -> Named:
    """The explanation with every effect in the recordings only that it makes better."""
    evidence, naming = named.group.evidence, named.naming
    if len(evidence.observed) == 1 or _quiet(named, naming.best.fitted):
        return named
    best = _excepted(naming, evidence, naming.best)
    if best.left_heldout > UNEXPLAINED:
        alone = _alone(named, candidates, deadline)
        if alone is not None:
            alone = _excepted(naming, evidence, alone)
            best = alone if worth(best, replace(alone, words=(*best.words, ""))) else best
    return replace(named, naming=replace(naming, best=best))


def foretold(named: Named) -> list[Foretold]:
    """Every recording held out as a whole: its curves and clock are its own, the physics that of the others."""
    evidence, best = named.group.evidence, named.naming.best.fitted
    found = []
    n_clock = len(best.theta) - sum(map(len, best.candidates))
    for i, each in enumerate(evidence.observed):
        part = evidence.part(i)
        others = Hypothesis(evidence, best.candidates).fit(best.theta, evidence.recording != i)
        own = [c for c in best.candidates if c.works_in(i)]
        values = [theta for c, theta in zip(best.candidates, others.values(), strict=True) if c.works_in(i)]
        clock = best.theta[2 * i : 2 * i + 2] if n_clock else best.theta[:0]
        after = _held(part, [replace(c, recordings=None) for c in own], np.concatenate([clock, *values]))
        above = len(named.group.slots) / evidence.y.shape[1]
        found.append(Foretold(each.name, *(float(np.sqrt(x / above)) for x in (_held(part, [], clock), after))))
    return found


def _held(part: Evidence, candidates: Sequence[Candidate], theta: Array) -> float:
    """Mean square on held-out blocks, with the physics at `theta` and the clock fitted."""
    hypothesis = Hypothesis(part, candidates)
    theta, fold = hypothesis.fit_clocks(theta).theta, folds(part)
    left = np.empty(part.y.shape)
    for i in range(N_FOLDS):
        out = fold == i
        left[out] = hypothesis.fit(theta, ~out, most_steps=0).residual[out]
    return float(np.mean(left**2))


def _quiet(named: Named, fitted: Fitted) -> bool:
    """Whether it leaves no recording with more than its noise."""
    evidence = named.group.evidence
    above = [
        np.mean(fitted.residual[evidence.recording == i] ** 2) - np.mean(noise_of_blocks(evidence.part(i).y) ** 2)
        for i in range(len(evidence.observed))
    ]
    return all(named.group.per_taxel(float(each)) < LEAST_EXCESS**2 for each in above)


def _judged(naming: Naming, evidence: Evidence, fitted: Fitted) -> Tried:
    mean_square, thetas = heldout(fitted, evidence, naming.null.fitted.effective_pa.mean(axis=1))
    words = tuple(each.word for each in fitted.candidates)
    fitted_to = left(fitted, evidence, naming.floor, naming.excess)
    return Tried(words, fitted, fitted_to, (mean_square - naming.floor) / naming.excess, thetas)


def _excepted(naming: Naming, evidence: Evidence, best: Tried) -> Tried:
    """`best` with each effect taken out of the recordings that are predicted better without it."""
    every = frozenset(range(len(evidence.observed)))
    while True:
        tried = []
        for at, each in enumerate(best.fitted.candidates):
            there = every if each.recordings is None else each.recordings
            for i in there if len(there) > 1 else ():
                fewer = replace(each, recordings=there - {i})
                changed = [fewer if j == at else other for j, other in enumerate(best.fitted.candidates)]
                tried.append(_judged(naming, evidence, Hypothesis(evidence, changed).fit(best.fitted.theta)))
        better = min(tried, key=lambda each: each.left_heldout, default=None)
        if better is None or not worth(best, replace(better, words=(*best.words, ""))):
            return best
        best = better


def _alone(named: Named, candidates: Mapping[str, Candidate], deadline: float) -> Tried | None:
    """What each recording says by itself, put together: each effect where it was named."""
    evidence, naming = named.group.evidence, named.naming
    namings = [
        name((part := evidence.part(i)), candidates, float(np.mean(noise_of_blocks(part.y) ** 2)), deadline)
        for i in range(len(evidence.observed))
    ]
    explained = [each.excess * (1.0 - max(each.best.left_heldout, 0.0)) for each in namings]
    there: dict[str, frozenset[int]] = {}
    values: dict[str, Array] = {}
    for i in np.argsort(explained)[::-1].tolist():
        for each, own in zip(namings[i].best.fitted.candidates, namings[i].best.fitted.values(), strict=True):
            there[each.word] = there.get(each.word, frozenset()) | {i}
            values.setdefault(each.word, own)
    if not 0 < len(there) <= MOST_EFFECTS:
        return None
    hypothesis = Hypothesis(evidence, [replace(candidates[word], recordings=own) for word, own in there.items()])
    clocks = np.concatenate([each.best.fitted.clocks().ravel() for each in namings])
    theta = np.concatenate([clocks, *(values[each.word] for each in hypothesis.candidates)])
    return _judged(naming, evidence, hypothesis.polished(hypothesis.fit(theta)))
