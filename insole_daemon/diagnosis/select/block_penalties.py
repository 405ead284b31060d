"""Penalties of sets of candidates if the load is known on every taxel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..model.blocks import BlockDesign
from ..model.design import LEAST_GAIN
from ..model.regression import PlacedTerm
from .penalty_parts import MISFIT_OF_STATIC, ODDS, most_misfit, search_penalty

MOST_SQUARE = 1.5  # of a static effect, in that of the mismatch: a larger one would cancel another effect
WITHIN_PRIORS = 4.0  # times the misfit of others: least size of a static effect that nuisances could absorb
# Fraction of a memory's mean square that the law of another family leaves: plays of Dahl's friction, sums of
# relaxations of activated creep.
MISFIT_OF_MEMORY = 0.1
# Part of an effect that a preferred term may leave (Term.yields_to): a drift may have any time course, and creep is a
# family of laws that contains others approximately.
WIDER = {"drift": 0.01, "creep": 0.002}
# Fraction LOCAL of a misfit that a term on at most SMALL of the triangles may explain: the law has the same misfit on
# the other triangles, so it does not require a second effect. The drifts of a set are together one term.
LOCAL, SMALL = 0.25, 0.5
CANCELLED = 0.2  # of the smaller of two effects, squared: two that leave less together are no two effects


class BlockPenalties:
    """Penalties if the load is known on every taxel: triangles have rows of their own."""

    most_terms = 8

    def __init__(self, design: BlockDesign) -> None:
        self.design = design
        self._n_triangles = design.mask.sum(axis=1)  # of each column
        self._seen: dict[int, bool] = {}
        self._least = [
            LEAST_GAIN if design.is_within_priors(candidate) else least
            for candidate, least in zip(design.candidates, design.least.tolist(), strict=True)
        ]

    def least_gain(self, k: int) -> float:
        """Return the gain of the smallest effect on the taxels of candidate `k`."""
        return self._least[k]

    def complexity_penalty(self, candidate: PlacedTerm) -> float:
        """Return the complexity penalty for the columns, places and settings of the candidate."""
        n = float(len(candidate.columns)) if candidate.term.share != "whole" else 0.0
        return search_penalty(candidate, n, self.design.n_rows, float(self.design.least.max()))

    def term_penalty(self, k: int, candidate: PlacedTerm, terms: Sequence[PlacedTerm]) -> float:
        """Return the penalty, which does not depend on the other terms."""
        return self._least[k] + self.complexity_penalty(candidate)

    def least_penalty(self, k: int) -> float:
        """Return the penalty without the misfit of other terms."""
        return self.term_penalty(k, self.design.candidates[k], ())

    def set_penalty(
        self, chosen: Sequence[int], terms: Sequence[PlacedTerm], shares: Sequence[Array], left: float
    ) -> float:
        """Return the penalties of all terms with the misfit of the others; inf if a term is not distinguishable.

        A static term, which differs from nuisance columns only by its priors, must be larger than its least gain plus
        WITHIN_PRIORS times the misfit of the others. It must not cancel others: beside companions it is smaller than
        MOST_SQUARE times what the calibration leaves, else than 1 / CANCELLED times. The misfit beside a memory is
        limited by what the set leaves (UNDESCRIBED).
        """
        if self._cancel(terms, shares):
            return np.inf
        has_companions = any(len(one.companions) for one in terms)
        penalty = self._sibling_penalty(terms, shares)
        for i, candidate in enumerate(terms):
            if candidate.term.share == "whole" and not self._is_seen(chosen[i]):
                return np.inf
            misfit = self._misfit(terms, shares, i)
            if candidate.term.is_memory:
                misfit = min(misfit, most_misfit(self.design, left))
            penalty += self.term_penalty(chosen[i], candidate, terms)
            if self.design.is_within_priors(candidate):
                least = float(self.design.least[chosen[i]]) + WITHIN_PRIORS * misfit
                most = (MOST_SQUARE if has_companions else 1.0 / CANCELLED) * self.design.mismatch(candidate)
                if not least < self.design.size(candidate, shares[i]) < most:
                    return np.inf
            else:
                penalty += misfit
        return penalty

    def _cancel(self, terms: Sequence[PlacedTerm], shares: Sequence[Array]) -> bool:
        """Return whether two effects nearly cancel each other where both are."""
        for i, one in enumerate(terms):
            for other, other_shares in zip(terms[:i], shares[:i], strict=True):
                products = self.design.products_of_two(one, other, shares[i], other_shares, raw=True)
                if products.sum() < CANCELLED * products.diagonal().min():
                    return True
        return False

    def _sibling_penalty(self, terms: Sequence[PlacedTerm], shares: Sequence[Array]) -> float:
        """Return the penalty of memories that are selected at several places: the misfit of one law at all of them.

        Snaps have none, because they have different thresholds at different places.
        """
        penalty = 0.0
        for i, one in enumerate(terms):
            if one.term.absorbs and one.word != "snap" and any(other.word == one.word for other in terms[:i]):
                whole = sum(
                    self.design.size(sibling, own)
                    for sibling, own in zip(terms, shares, strict=True)
                    if sibling.word == one.word
                )
                penalty += one.term.misfit_of(True) * whole
        return penalty

    def timing_penalty(self, terms: Sequence[PlacedTerm], shares: Sequence[Array], left: float) -> float:
        """Return the penalty of a term of the whole insole, plus the misfit of the set."""
        return float(self.design.least.max()) + ODDS + self.misfit(terms, shares)

    def misfit(self, terms: Sequence[PlacedTerm], shares: Sequence[Array]) -> float:
        """Return the sum of squares that the laws of the set `terms` may fail to describe."""
        return sum(
            one.term.misfit_of(True) * self.design.size_of_loop(one, own)
            for one, own in zip(terms, shares, strict=True)
        )

    def tolerated_loss(self, candidate: PlacedTerm, shares: Array) -> float:
        """Return the part WIDER of the effect: under a known load the rows show what a law does not describe."""
        return WIDER.get(candidate.word, 0.0) * self.design.size_of_loop(candidate, shares)

    def _misfit(self, terms: Sequence[PlacedTerm], shares: Sequence[Array], i: int) -> float:
        """Return the misfit of the other terms of a set in the triangles of term `i`, as a sum of squares.

        A memory beside another memory or a snap in the same triangles has to allow for the misfit of one law for the
        effect of both, because the two may be parts of one effect that neither law describes. This does not apply if
        the memory acts on far more triangles than the other term.
        """
        one, misfit = terms[i], 0.0
        for j, (other, own) in enumerate(zip(terms, shares, strict=True)):
            if j == i:
                continue
            are_static = self.design.is_within_priors(one) and self.design.is_within_priors(other)
            part = MISFIT_OF_STATIC if are_static else other.term.misfit_of(True)
            alike = LOCAL if self._is_small_beside(one, other, terms) else 1.0
            if part > 0.0:
                misfit += alike * part * self.design.overlap(one, other, own)
            if one.term.is_memory and other.term.is_loop and not self._is_small_beside(other, one, terms):
                part = MISFIT_OF_MEMORY / (2.0 if other.term.is_memory else 1.0)
                misfit += alike * part * float(self.design.products_of_two(one, other, shares[i], own, raw=False).sum())
        return one.term.likeness * misfit

    def _is_small_beside(self, one: PlacedTerm, other: PlacedTerm, terms: Sequence[PlacedTerm]) -> bool:
        """Return whether `other` acts on far more triangles than `one`, and `one` is not absorbed by calibrations.

        Drifts of the set at several places count as one: the same drift of every board is one of the insole.
        """
        if self.design.is_within_priors(one):
            return False
        alike = [term for term in terms if term.word == "drift"] if one.word == "drift" else [one]
        n = sum(int(self._n_triangles[term.columns[0]]) for term in alike)
        return n <= SMALL * int(self._n_triangles[other.columns[0]])

    def _is_seen(self, k: int) -> bool:
        """Return whether the residual contains more than half of candidate `k` (`BlockDesign.is_seen`)."""
        if k not in self._seen:
            self._seen[k] = self.design.is_seen(self.design.candidates[k])
        return self._seen[k]
