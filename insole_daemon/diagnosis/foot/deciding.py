"""From sets and what they leave to words: what is denoising, what cannot be told apart, what nothing known explains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from .naming import Naming, Search, Tried, by_words

UNEXPLAINED = 0.25  # of the mismatch that the best set leaves: it is something else
LEAST_UNEXPLAINED = 1.0  # of the noise's mean square, too
# Of what an effect takes away: where the same filter run backwards takes away more, it is denoising. A lag flattens
# edges as its reverse does, and a delay makes up for the rest; which of the two is better is all that tells.
DECOY = {"hysteresis": 0.5, "viscoelasticity": 0.5, "lag": 1.0}
AS_GOOD = 1.6  # times what the best set leaves: a swap that leaves less is as good


@dataclass(frozen=True, slots=True, eq=False)
class Decided:
    """What is said of the walks."""

    best: Tried
    alternatives: Mapping[str, tuple[str, ...]]  # by word
    confidence: Mapping[str, float]  # by word
    alone: Mapping[str, Tried]  # by word: the set without it
    decoys: Mapping[str, float]  # by word: what its decoy leaves in its place
    denoising: tuple[str, ...]  # words that were admitted, and whose decoy was as good
    unknown: bool


def decide(search: Search, naming: Naming) -> Decided:
    """The best set without what a decoy explains as well, and what could stand in its place."""
    best, decoys, denoising = naming.best, dict[str, float](), list[str]()
    for term in sorted(naming.best.terms, key=lambda each: each.word):
        if term.word not in DECOY:
            continue  # of a delay it is an earlier reading, which the bounds refuse
        without = search.judged(best.terms - {term})
        decoy = search.judged(best.terms - {term} | {replace(term, backwards=True)})
        decoys[term.word] = decoy.left
        if without.left - decoy.left > DECOY[term.word] * (without.left - best.left):
            denoising.append(term.word)
            best = without
    judged = by_words(each for each in naming.tried if not any(term.backwards for term in each.terms))
    alternatives: dict[str, tuple[str, ...]] = {}
    confidence: dict[str, float] = {}
    alone: dict[str, Tried] = {}
    limit = best.left + max((AS_GOOD - 1.0) * max(best.left - 1.0, 0.0), naming.price)
    for term in best.terms:
        rest = best.words - {term.word}
        alone[term.word] = search.judged(best.terms - {term})
        swaps = sorted(
            (tried.left, min(words - rest)) for words, tried in judged.items()
            if len(words) == len(best.words) and rest < words and words != best.words and tried.left <= limit
        )  # fmt: skip
        alternatives[term.word] = tuple(word for _, word in swaps)
        rival = min((t.left for words, t in judged.items() if term.word not in words and len(words) <= len(best.words)),
                    default=naming.static.left)  # fmt: skip
        margin = max(rival - 1.0, 1e-3) / max(best.left - 1.0, naming.price)
        confidence[term.word] = float(np.clip(1.0 - 0.5 / margin, 0.3, 0.99))
    unknown = _unexplained(naming.static, best)
    return Decided(best, alternatives, confidence, alone, decoys, tuple(denoising), unknown)


def refitted(search: Search, naming: Naming, decided: Decided) -> tuple[Naming, Decided]:
    """What was decided, fitted to the evidence of `search`: the same walks, recalibrated otherwise."""
    static, terms = search.judged(frozenset()), decided.best.terms
    best, alone = search.judged(terms), {term.word: search.judged(terms - {term}) for term in terms}
    unknown = decided.unknown and _unexplained(static, best)
    return replace(naming, static=static), replace(decided, best=best, alone=alone, unknown=unknown)


def _unexplained(static: Tried, best: Tried) -> bool:
    return best.left - 1.0 > max(UNEXPLAINED * max(static.left - 1.0, 0.0), LEAST_UNEXPLAINED)
