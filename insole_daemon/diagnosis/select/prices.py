"""What a set of candidates has to explain before it is believed, in squared residual.

Where only sums of the load are known, prices follow the wrench; where it is known on every taxel, each triangle has
rows of its own, and prices follow the triangles a term is at.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ...physics.law import Array
from ..model.blocks import BlockDesign
from ..model.design import LEAST_GAIN, Design
from ..model.regression import PlacedTerm, Regression

LEAST_EVIDENCE = 40.0  # that a recalibration beyond its priors has to explain
EARLY = 4.0  # least gains more: that readings come before their load is the last thing to believe
WITHIN_PRIORS = 4.0  # times the misfit of others: a share of it that nuisances can take makes no evidence
MISSED_OF_MEMORY = (
    0.1  # of a memory, that another family's law leaves, squared: plays of Dahl's, sums of activated creep
)
# Of a static word, that another one at the same place may take, squared: what changes a curve has one cause, which is
# no word exactly. Times WITHIN_PRIORS, a tenth.
MISSED_OF_STATIC = 0.025
# Of it, that a likelier effect may leave and still be it: a drift can have any course, and creep is a wider family.
WIDER = {"drift": 0.01, "creep": 0.002}
# Of what a law misses, that a term on less than a SMALL part of its triangles may take: the others miss the same.
LOCAL, SMALL = 0.25, 0.5
ODDS = 8.0  # that the choice among the terms costs


class Prices(Protocol):
    """Of the sets of one design."""

    most_terms: int  # of a set

    def least(self, k: int) -> float:
        """What candidate `k` has to explain at the least; margins are told in it."""

    def surcharge(self, candidate: PlacedTerm) -> float:
        """What its free shares and the places and settings that were searched cost."""

    def least_price(self, k: int, candidate: PlacedTerm, every: Sequence[PlacedTerm]) -> float:
        """What `candidate`, number `k`, of the set `every` has to explain, whatever the others leave."""

    def of_set(self, chosen: Sequence[int], every: Sequence[PlacedTerm], shares: Sequence[Array]) -> float:
        """Of all candidates, and of what the others may leave that no law describes; inf: it makes no sense."""

    def of_timing(self, every: Sequence[PlacedTerm], shares: Sequence[Array]) -> float:
        """Of a delay or a lag of the whole insole beside the set `every`."""

    def of_laws(self, every: Sequence[PlacedTerm], shares: Sequence[Array]) -> float:
        """What the laws of the set `every` may fail to describe."""

    def loose(self, candidate: PlacedTerm, shares: Array) -> float:
        """What a likelier term in its place may explain less."""


def prices_of(design: Regression) -> Prices:
    """Those of the kind of `design`."""
    if isinstance(design, BlockDesign):
        return BlockPrices(design)
    assert isinstance(design, Design)
    return WrenchPrices(design)


def _of_searching(candidate: PlacedTerm, n_columns: float, n_rows: int, least_gain: float) -> float:
    searched = candidate.n_places * (1 + 4 * len(candidate.term.refine))
    early = EARLY * least_gain if candidate.settings[0].get("early_s") else 0.0
    n = n_columns + 0.5 * len(candidate.companions)
    return float(early + ODDS + n * np.log(n_rows) + 2 * np.log(searched))


class WrenchPrices:
    """Every place adds to the same rows."""

    most_terms = 5

    def __init__(self, design: Design) -> None:
        self.design = design
        self.least_gain = float(design.least[0])

    def least(self, k: int) -> float:
        """The same of all."""
        return self.least_gain

    def surcharge(self, candidate: PlacedTerm) -> float:
        """The priors of the base are the price of a recalibration's shares."""
        is_free = candidate.term.share != "whole" and not candidate.is_recalibration
        n = float(len(candidate.columns)) if is_free else 0.0
        return _of_searching(candidate, n, self.design.n_rows, self.least_gain)

    def least_price(self, k: int, candidate: PlacedTerm, every: Sequence[PlacedTerm]) -> float:
        """What the base absorbs of a recalibration is no part of it, unless a memory may have been calibrated in."""
        is_alone = not any(each.term.absorbs for each in every)
        least_gain = self._least_gain_of(candidate) if is_alone else self.least_gain
        return least_gain + self.surcharge(candidate)

    def _least_gain_of(self, candidate: PlacedTerm) -> float:
        """What a candidate has to explain beside the base: less, where the base absorbs a part of its size."""
        if not candidate.is_recalibration:
            return self.least_gain
        kept = float(self.design.kept_share[candidate.columns].max())
        return float(np.clip(np.sqrt(kept) * self.least_gain, LEAST_EVIDENCE, self.least_gain))

    def of_set(self, chosen: Sequence[int], every: Sequence[PlacedTerm], shares: Sequence[Array]) -> float:
        """Of the same term elsewhere, what they explain together counts in its misfit.

        An effect of the insole that is put together from many places leaves no less.
        """
        if not every:
            return 0.0
        effect = self.design.gram[:, np.concatenate([each.columns for each in every])]
        starts = np.cumsum([0, *(len(each.columns) for each in every)])
        products = np.zeros((len(every), len(every)))  # of the effects of two candidates
        for i, own in enumerate(every):
            weighted = shares[i] @ effect[own.columns] * np.concatenate(shares)
            products[i] = np.add.reduceat(weighted, starts[:-1])
        misfits = np.array([each.term.misfit_of(each.term.is_of_load) for each in every])
        words = np.array([each.word for each in every])
        price = 0.0
        for i, candidate in enumerate(every):
            other = words != words[i]
            siblings = (words == words[i]) & (np.arange(len(every)) != i)
            left = float(misfits[other] @ np.diag(products)[other])
            left += misfits[i] * max(float(products[np.ix_(siblings, siblings)].sum()), 0.0)
            price += self.least_price(chosen[i], candidate, every) + min(left, float(products[i, i]))
            if candidate.is_recalibration and candidate.term.plausible:
                # A little everywhere is likelier than very much at one place.
                price += 2.0 * np.log1p((float(np.abs(shares[i]).max()) / candidate.term.plausible) ** 2)
        return price

    def of_timing(self, every: Sequence[PlacedTerm], shares: Sequence[Array]) -> float:
        """That of a term without places."""
        return self.least_gain + ODDS

    def of_laws(self, every: Sequence[PlacedTerm], shares: Sequence[Array]) -> float:
        """Each one's misfit."""
        return sum(self.loose(each, own) for each, own in zip(every, shares, strict=True))

    def loose(self, candidate: PlacedTerm, shares: Array) -> float:
        """Its misfit."""
        own = self.design.gram[np.ix_(candidate.columns, candidate.columns)]
        return candidate.term.misfit_of(candidate.term.is_of_load) * float(shares @ own @ shares)


class BlockPrices:
    """Triangles have rows of their own."""

    most_terms = 8

    def __init__(self, design: BlockDesign) -> None:
        self.design = design
        self._seen: dict[int, bool] = {}
        self._least = [
            LEAST_GAIN if design.is_within_priors(each) else least
            for each, least in zip(design.candidates, design.least.tolist(), strict=True)
        ]

    def least(self, k: int) -> float:
        """By the taxels it is at."""
        return self._least[k]

    def surcharge(self, candidate: PlacedTerm) -> float:
        """Of its columns and places."""
        n = float(len(candidate.columns)) if candidate.term.share != "whole" else 0.0
        return _of_searching(candidate, n, self.design.n_rows, float(self.design.least.max()))

    def least_price(self, k: int, candidate: PlacedTerm, every: Sequence[PlacedTerm]) -> float:
        """The same beside any others."""
        return self._least[k] + self.surcharge(candidate)

    def of_set(self, chosen: Sequence[int], every: Sequence[PlacedTerm], shares: Sequence[Array]) -> float:
        """What nuisances could be but for their priors has to be larger than others may fail to describe, too."""
        price = self._of_siblings(every, shares)
        for i, candidate in enumerate(every):
            if candidate.term.share == "whole" and not self._is_seen(chosen[i]):
                return np.inf
            misfit = self._misfit(every, shares, i)
            price += self.least_price(chosen[i], candidate, every)
            if self.design.is_within_priors(candidate):
                least = float(self.design.least[chosen[i]]) + WITHIN_PRIORS * misfit
                if self.design.size(candidate, shares[i]) <= least:
                    return np.inf
            else:
                price += misfit
        return price

    def _of_siblings(self, every: Sequence[PlacedTerm], shares: Sequence[Array]) -> float:
        """Of the same memory at several places: as likely as that one law misses so much of all of them.

        Snaps have thresholds of their own at every place.
        """
        price = 0.0
        for i, one in enumerate(every):
            if one.term.absorbs and one.word != "snap" and any(other.word == one.word for other in every[:i]):
                whole = sum(
                    self.design.size(each, own)
                    for each, own in zip(every, shares, strict=True)
                    if each.word == one.word
                )
                price += one.term.misfit_of(True) * whole
        return price

    def of_timing(self, every: Sequence[PlacedTerm], shares: Sequence[Array]) -> float:
        """That of a term of the whole insole, with what the set may fail to describe."""
        return float(self.design.least.max()) + ODDS + self.of_laws(every, shares)

    def of_laws(self, every: Sequence[PlacedTerm], shares: Sequence[Array]) -> float:
        """What the laws of the set `every` may fail to describe."""
        return sum(
            each.term.misfit_of(True) * self.design.size_of_loop(each, own)
            for each, own in zip(every, shares, strict=True)
        )

    def loose(self, candidate: PlacedTerm, shares: Array) -> float:
        """Next to nothing: where the load is known, what a law misses is seen."""
        return WIDER.get(candidate.word, 0.0) * self.design.size_of_loop(candidate, shares)

    def _misfit(self, every: Sequence[PlacedTerm], shares: Sequence[Array], i: int) -> float:
        """What number `i` may take of what the others of a set fail to describe where it is at work, squared.

        A memory beside another loop at the same place is the likeliest to describe what the law of one of them misses
        of both: they share what it would have been alone. A memory that is at work on far more triangles is not.
        """
        one, missed = every[i], 0.0
        for j, (other, own) in enumerate(zip(every, shares, strict=True)):
            if j == i:
                continue
            are_static = self.design.is_within_priors(one) and self.design.is_within_priors(other)
            part = MISSED_OF_STATIC if are_static else other.term.misfit_of(True)
            alike = LOCAL if self._is_small_beside(one, other) else 1.0
            missed += alike * part * self.design.overlap(one, other, own)
            if one.term.is_memory and other.term.is_loop and not self._is_small_beside(other, one):
                part = MISSED_OF_MEMORY / (2.0 if other.term.is_memory else 1.0)
                missed += alike * part * self.design.overlap_of_both(one, other, shares[i], own)
        return one.term.likeness * missed

    def _is_small_beside(self, one: PlacedTerm, other: PlacedTerm) -> bool:
        """Whether `other` is at work on far more triangles, and could not be in their calibrations, one by one."""
        if self.design.is_within_priors(one):
            return False
        mask = self.design.mask
        return bool(mask[one.columns[0]].sum() <= SMALL * mask[other.columns[0]].sum())

    def _is_seen(self, k: int) -> bool:
        if k not in self._seen:
            self._seen[k] = self.design.is_seen(self.design.candidates[k])
        return self._seen[k]
