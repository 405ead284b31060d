"""Which physics was left out of walks: every set of effects, where in the insole, and the price of one more.

Sets are judged by what they leave on whole steps that were held out, in units of the noise: 1 is nothing. One more
effect has to take away more than noise and denoising do (`nulls`), a share of the whole mismatch and most of what the
smaller set leaves: a family of curves never is the material's own, and what is left of a strong effect is no other one.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ...physics.law import Array
from .evidence import Evidence
from .hypothesis import ORDER, Fitted, Hypothesis, Term
from .part import N_FOLDS

PRICES = ((0.03, 0.4), (0.003, 0.6))  # of the whole mismatch, and of what the smaller set leaves
TIMING = ("lag", "delay")  # are what they are: what these leave is the whole mismatch of a family of materials
SPREAD = ("hysteresis", "viscoelasticity")  # what a part of the insole may have by itself
LEAST_LEFT = 0.15  # of the noise's mean square
KEPT = 4  # sets of each size that are judged on held-out steps
PLACED = 2  # of these, whose effects are tried on parts of the insole, and then judged


@dataclass(frozen=True, slots=True, eq=False)
class Tried:
    """One set, fitted."""

    terms: frozenset[Term]
    fitted: Fitted
    without: tuple[Fitted, ...] = ()  # fits that have not seen one fold each
    heldout: Array | None = None  # (n, 3) what these leave of the rows of theirs
    square: Array | None = None  # (n,) its mean square over the channels, less the noise that undoing effects adds
    left: float = np.inf  # mean of that over the rows that are judged

    @property
    def words(self) -> frozenset[str]:
        """Of its effects."""
        return frozenset(each.word for each in self.terms)


def std(of_folds: Array) -> Array:
    """(k,) jackknife of values (folds, k) that the fits without each fold have."""
    spread = of_folds - of_folds.mean(axis=0)
    found: Array = np.sqrt((N_FOLDS - 1) / N_FOLDS * np.sum(spread**2, axis=0))
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Naming:
    """All that was tried."""

    static: Tried
    best: Tried
    tried: tuple[Tried, ...]
    price: float  # of one more effect, in mean squares of the noise


class Search:
    """Every set of effects that the evidence may tell."""

    def __init__(self, evidence: Evidence, price: float) -> None:
        self.evidence = evidence
        self.price = price
        own = any(part.walk.shoe.clock == "own" for part in evidence.parts)
        self.words = [word for word in ORDER if not (own and word == "delay")]
        self._fitted: dict[frozenset[Term], Tried] = {}

    def name(self, deadline: float) -> Naming:
        """The best set; `deadline` (monotonic): no larger ones are begun after it."""
        static = self.judged(frozenset())
        best = static
        for size in range(1, len(self.words) + 1):
            # What is left is less than any effect that is worth a word: no larger set could win.
            if size > 1 and (best.left - 1.0 < LEAST_LEFT or time.monotonic() > deadline):
                break
            tried = sorted((self._tried(_terms(c)) for c in combinations(self.words, size)), key=_fits)[:KEPT]
            whole = sorted((self.judged(each.terms) for each in tried), key=_left)
            parts = [self._tried(terms) for each in whole[:PLACED] for terms in self._placed(each.terms)]
            placed = sorted((self.judged(each.terms) for each in sorted(parts, key=_fits)[:PLACED]), key=_left)
            challenger = whole[0]
            if placed and placed[0].left < challenger.left - self.price:  # a place has its price too
                challenger = placed[0]
            if self.worth(static, best, challenger):
                best = challenger
        return Naming(
            static, best, tuple(each for each in self._fitted.values() if each.heldout is not None), self.price
        )

    def judged(self, terms: frozenset[Term]) -> Tried:
        """`terms` fitted, and judged on held-out steps."""
        tried = self._tried(terms)
        if tried.heldout is None:
            hypothesis, evidence = Hypothesis(self.evidence, tuple(terms)), self.evidence
            without = hypothesis.without_each_fold(tried.fitted)
            heldout, square = np.zeros((len(evidence.fold), 3)), np.zeros(len(evidence.fold))
            for fold, fitted in enumerate(without):
                own = evidence.fold == fold
                heldout[own] = hypothesis.left(fitted, fold)[own]
                square[own] = (np.mean(heldout**2, axis=1) - hypothesis.added_noise(fitted))[own]
            left = float(np.mean(square[evidence.judged]))
            tried = replace(tried, without=tuple(without), heldout=heldout, square=square, left=left)
            self._fitted[terms] = tried
        return tried

    def worth(self, static: Tried, smaller: Tried, larger: Tried) -> bool:
        """Whether `larger` is worth its price beside `smaller`."""
        more = len(larger.terms) - len(smaller.terms)
        timing = frozenset(each for each in larger.terms if each.word in TIMING)
        mismatch = static if timing == larger.terms else self.judged(timing)
        whole, rest = max(mismatch.left - 1.0, 1e-9), max(smaller.left - 1.0, 0.0)
        gain = smaller.left - larger.left
        return gain > self.price * more and any(
            gain > price * more * whole and gain > (1 - (1 - share) ** more) * rest for price, share in PRICES
        )

    def _tried(self, terms: frozenset[Term]) -> Tried:
        if terms not in self._fitted:
            self._fitted[terms] = Tried(terms, Hypothesis(self.evidence, tuple(terms)).fit())
        return self._fitted[terms]

    def _placed(self, terms: frozenset[Term]) -> Iterable[frozenset[Term]]:
        """`terms` with one of those that a part may have by itself on one board."""
        for term in terms:
            if term.word in SPREAD:
                for board in self.evidence.boards:
                    yield terms - {term} | {replace(term, boards=(board,))}


def by_words(tried: Iterable[Tried]) -> Mapping[frozenset[str], Tried]:
    """The best of `tried` for each set of words."""
    found: dict[frozenset[str], Tried] = {}
    for each in sorted(tried, key=_left):
        found.setdefault(each.words, each)
    return found


def _terms(words: Iterable[str]) -> frozenset[Term]:
    return frozenset(Term(word) for word in words)


def _fits(tried: Tried) -> float:
    return tried.fitted.mean_square


def _left(tried: Tried) -> float:
    return tried.left
