"""Penalties of sets of candidates: the gain that a set needs to be selected, in variances of the noise.

A penalty has three parts: the gain of the smallest effect that is reported; a complexity penalty for free shares (as in
the Bayesian information criterion, Schwarz, Ann. Statist. 6 (1978) 461) and for the places and settings that were
searched; and the misfit of the other terms' laws, which a wrongly selected term could explain.

If only the wrench is known, all places add to the same rows. If the load is known on every taxel, each triangle has
rows of its own, and the penalty of a term depends on its triangles.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ...physics.law import Array
from ..model.blocks import BlockDesign
from ..model.design import LEAST_GAIN, Design
from ..model.regression import PlacedTerm, Regression
from ..model.solve import solve_companions, with_ridge
from ..terms import TERMS, mean_curve

LEAST_EVIDENCE = 40.0  # least gain of a recalibration of which the priors of nuisances absorb a part
EARLY = 4.0  # additional least gains if readings come before their load, the least plausible hypothesis
MOST_SQUARE = 1.5  # of a static effect, in that of the mismatch: a larger one would cancel another effect
WITHIN_PRIORS = 4.0  # times the misfit of others: least size of a static effect that nuisances could absorb
# Fraction of a memory's mean square that the law of another family leaves: plays of Dahl's friction, sums of
# relaxations of activated creep.
MISFIT_OF_MEMORY = 0.1
# The law of another memory describes at most half of a misfit, and so does a delay or lag of a walk: UNDESCRIBED times
# what the set leaves beyond the noise, of which the part LEAST_UNDESCRIBED is uncertain.
UNDESCRIBED, LEAST_UNDESCRIBED = 1.0, 0.1
# Fraction of a static effect's mean square that another one at the same place may explain: a changed curve has one
# cause, which no static word describes exactly. WITHIN_PRIORS makes it a tenth.
MISFIT_OF_STATIC = 0.025
# Part of an effect that a preferred term may leave (Term.yields_to): a drift may have any time course, and creep is a
# family of laws that contains others approximately.
WIDER = {"drift": 0.01, "creep": 0.002}
# Fraction LOCAL of a misfit that a term on at most SMALL of the triangles may explain: the law has the same misfit on
# the other triangles, so it does not require a second effect. The drifts of a set are together one term.
LOCAL, SMALL = 0.25, 0.5
CANCELLED = 0.2  # of the smaller of two effects, squared: two that leave less together are no two effects
ODDS = 8.0  # penalty for the choice of the word among all terms


class Penalties(Protocol):
    """Penalties of the sets of one design."""

    most_terms: int  # largest number of terms in a set

    def least_gain(self, k: int) -> float:
        """Return the gain of the smallest effect that candidate `k` may report; margins are in this unit."""

    def complexity_penalty(self, candidate: PlacedTerm) -> float:
        """Return the penalty for free shares and for the places and settings that were searched."""

    def term_penalty(self, k: int, candidate: PlacedTerm, terms: Sequence[PlacedTerm]) -> float:
        """Return the penalty of `candidate`, number `k`, in the set `terms`, without the misfit of the other terms."""

    def least_penalty(self, k: int) -> float:
        """Return the smallest penalty of candidate `k` in any set."""

    def set_penalty(
        self, chosen: Sequence[int], terms: Sequence[PlacedTerm], shares: Sequence[Array], left: float
    ) -> float:
        """Return the penalty of a set with the misfit of its laws; inf if the set is no valid model.

        `chosen`: numbers of the candidates `terms`; `shares`: their fitted shares; `left`: the squared residual.
        """

    def timing_penalty(self, terms: Sequence[PlacedTerm], shares: Sequence[Array], left: float) -> float:
        """Return the penalty of a delay or a lag of the whole insole beside the set `terms`.

        `left`: the squared residual of both.
        """

    def misfit(self, terms: Sequence[PlacedTerm], shares: Sequence[Array]) -> float:
        """Return the sum of squares that the laws of the set `terms` may fail to describe."""

    def tolerated_loss(self, candidate: PlacedTerm, shares: Array) -> float:
        """Return how much less a preferred term (Term.yields_to) in the place of `candidate` may explain."""


def penalties_of(design: Regression) -> Penalties:
    """Return the penalties for a known load or for a wrench, by the type of `design`."""
    if isinstance(design, BlockDesign):
        return BlockPenalties(design)
    assert isinstance(design, Design)
    return WrenchPenalties(design)


def _search_penalty(candidate: PlacedTerm, n_columns: float, n_rows: int, least_gain: float) -> float:
    """Return k ln(n) + 2 ln(m) + ODDS for k free columns, n rows, and m searched places and settings.

    A companion counts as half a column.
    """
    searched = candidate.n_places * (1 + 4 * len(candidate.term.refine))
    early = EARLY * least_gain if candidate.settings[0].get("early_s") else 0.0
    n = n_columns + 0.5 * len(candidate.companions)
    return float(early + ODDS + n * np.log(n_rows) + 2 * np.log(searched))


def _most_misfit(design: Regression, left: float) -> float:
    """Return the largest misfit of a law that another one describes, if the squared residual `left` remains."""
    return UNDESCRIBED * max(left - design.noise, LEAST_UNDESCRIBED * design.noise)


class WrenchPenalties:
    """Penalties if only the wrench is known: every place adds to the same rows."""

    most_terms = 5

    def __init__(self, design: Design) -> None:
        self.design = design
        self._smallest_gain = float(design.least[0])
        self._shown_at_rest: dict[int, bool] = {}
        undone = design.load.observation.undone
        self._undone_misfit = design.undone * max((t.misfit_of(False) for t in TERMS if t.word in undone), default=0.0)

    def least_gain(self, k: int) -> float:
        """Return the same gain for all candidates."""
        return self._smallest_gain

    def _is_shown_at_rest(self, k: int) -> bool:
        """Return whether the rows before the first load alone show candidate `k`, a static effect.

        No memory acts on them, so the misfit of its law explains nothing there.
        """
        if k not in self._shown_at_rest:
            candidate = self.design.candidates[k]
            needed = self._least_gain_of(candidate) + self.complexity_penalty(candidate)
            self._shown_at_rest[k] = candidate.is_recalibration and self.design.gain_at_rest(candidate) > needed
        return self._shown_at_rest[k]

    def complexity_penalty(self, candidate: PlacedTerm) -> float:
        """Return the complexity penalty; not for shares of a recalibration, which priors limit."""
        is_free = candidate.term.share != "whole" and not candidate.is_recalibration
        n = float(len(candidate.columns)) if is_free else 0.0
        return _search_penalty(candidate, n, self.design.n_rows, self._smallest_gain)

    def term_penalty(self, k: int, candidate: PlacedTerm, terms: Sequence[PlacedTerm]) -> float:
        """Return the penalty: lower for a recalibration, of which the nuisance columns absorb a part.

        Beside a memory it is not lower, because the calibration may contain the memory's mean curve, unless the rows
        before the first load show it.
        """
        is_clear = not any(one.term.absorbs for one in terms) or self._is_shown_at_rest(k)
        least_gain = self._least_gain_of(candidate) if is_clear else self._smallest_gain
        return least_gain + self.complexity_penalty(candidate)

    def least_penalty(self, k: int) -> float:
        """Return the penalty without a memory beside the candidate."""
        candidate = self.design.candidates[k]
        return self._least_gain_of(candidate) + self.complexity_penalty(candidate)

    def _least_gain_of(self, candidate: PlacedTerm) -> float:
        """Return the least gain of a candidate without the part of its size that nuisance columns absorb."""
        if not candidate.is_recalibration:
            return self._smallest_gain
        kept = float(self.design.kept_share[candidate.columns].max())
        return float(np.clip(np.sqrt(kept) * self._smallest_gain, LEAST_EVIDENCE, self._smallest_gain))

    def set_penalty(
        self, chosen: Sequence[int], terms: Sequence[PlacedTerm], shares: Sequence[Array], left: float
    ) -> float:
        """Return the penalties of all terms, each with the misfit of the others, at most its own sum of squares.

        Memories that a chamber's model undid are among the others. What a term's companions explain counts as its own.

        The same word at other places counts with the sum of squares of all of them together: an effect of the insole
        that was selected at many places has the misfit of one law. inf if a term only lends its mean curve to others.
        """
        if not terms:
            return 0.0
        coefficient = self._coefficients(terms, shares)
        if self._is_curve_alone(terms, shares, coefficient):
            return np.inf
        effect = self.design.gram[:, np.concatenate([one.columns for one in terms])]
        starts = np.cumsum([0, *(len(one.columns) for one in terms)])
        products = np.zeros((len(terms), len(terms)))  # of the effects of two candidates
        for i, own in enumerate(terms):
            weighted = shares[i] @ effect[own.columns] * np.concatenate(shares)
            products[i] = np.add.reduceat(weighted, starts[:-1])
        misfits = np.array([one.term.misfit_of(one.term.is_of_load) for one in terms])
        words = np.array([one.word for one in terms])
        penalty = 0.0
        for i, candidate in enumerate(terms):
            other = words != words[i]
            siblings = (words == words[i]) & (np.arange(len(terms)) != i)
            misfit = self._undone_misfit + float(misfits[other] @ np.diag(products)[other])
            misfit = 0.0 if self._is_shown_at_rest(chosen[i]) else misfit
            misfit += misfits[i] * max(float(products[np.ix_(siblings, siblings)].sum()), 0.0)
            columns = np.concatenate([candidate.columns, candidate.companions])
            gram = self.design.gram[columns[:, None], columns]
            explained = float(coefficient[columns] @ gram @ coefficient[columns])
            penalty += self.term_penalty(chosen[i], candidate, terms) + min(misfit, explained)
            if candidate.is_recalibration and candidate.term.plausible:
                # Prior of the share: small changes everywhere are more probable than a very large one at one place.
                penalty += 2.0 * np.log1p((float(np.abs(shares[i]).max()) / candidate.term.plausible) ** 2)
        return penalty

    def _coefficients(self, terms: Sequence[PlacedTerm], shares: Sequence[Array]) -> Array:
        """Return the coefficients (p,) of the columns of `terms` and of their companions; 0 for other columns."""
        own = np.concatenate([one.columns for one in terms])
        companions, of_companions = solve_companions(self.design, terms, shares)
        coefficient = np.zeros(len(self.design.cross))
        coefficient[own], coefficient[companions] = np.concatenate(shares), of_companions
        return coefficient

    def _is_curve_alone(self, terms: Sequence[PlacedTerm], shares: Sequence[Array], coefficient: Array) -> bool:
        """Return whether a memory or snap moves the readings hardly more than a changed static curve does.

        A play wider than the load never moves, and is then nothing but a reason for a mean curve. `coefficient`: as of
        `_coefficients`.
        """
        for one, of_term in zip(terms, shares, strict=True):
            if not one.companions_of(mean_curve.TERM.word):
                continue
            columns = np.concatenate([one.columns, one.companions])
            gram = self.design.gram[columns[:, None], columns]
            whole = float(coefficient[columns] @ gram @ coefficient[columns])
            k = len(one.columns)
            static = np.linalg.solve(with_ridge(gram[k:, k:]), gram[k:, :k] @ of_term)
            moving = float(of_term @ gram[:k, :k] @ of_term - of_term @ gram[:k, k:] @ static)
            if moving < max(self._smallest_gain, MISFIT_OF_STATIC * whole):
                return True
        return False

    def timing_penalty(self, terms: Sequence[PlacedTerm], shares: Sequence[Array], left: float) -> float:
        """Return the penalty of a term without places, plus the misfit of the set, limited by what the set leaves."""
        misfit = min(self.misfit(terms, shares), _most_misfit(self.design, left))
        return self._smallest_gain + ODDS + misfit

    def misfit(self, terms: Sequence[PlacedTerm], shares: Sequence[Array]) -> float:
        """Return the sum of the misfits of the terms, and of the memories that were undone."""
        return self._undone_misfit + sum(self.tolerated_loss(*each) for each in zip(terms, shares, strict=True))

    def tolerated_loss(self, candidate: PlacedTerm, shares: Array) -> float:
        """Return the misfit of the candidate."""
        own = self.design.gram[np.ix_(candidate.columns, candidate.columns)]
        return candidate.term.misfit_of(candidate.term.is_of_load) * float(shares @ own @ shares)


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
        return _search_penalty(candidate, n, self.design.n_rows, float(self.design.least.max()))

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
                misfit = min(misfit, _most_misfit(self.design, left))
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
