"""Penalties of sets of candidates if only the wrench of the load is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..model.design import Design
from ..model.regression import PlacedTerm
from ..model.solve import solve_companions, with_ridge
from ..terms import TERMS, mean_curve, viscoelasticity
from .penalty_parts import MISFIT_OF_STATIC, ODDS, most_misfit, search_penalty

LIKE_A_LAG = frozenset({viscoelasticity.TERM.word})  # memories whose misfit a lag describes
LEAST_EVIDENCE = 40.0  # least gain of a recalibration of which the priors of nuisances absorb a part


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
        return search_penalty(candidate, n, self.design.n_rows, self._smallest_gain)

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
            # Without the noise of its columns, a Gram matrix may have a negative square for large coefficients.
            explained = max(float(coefficient[columns] @ gram @ coefficient[columns]), 0.0)
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
        """Return the penalty of a term without places, plus the misfit of the set, limited by what the set leaves.

        That of a viscoelasticity is not limited: a lag, a relaxation too, describes what one time constant leaves.
        """
        alike = sum(
            self.tolerated_loss(one, own) for one, own in zip(terms, shares, strict=True) if one.word in LIKE_A_LAG
        )
        misfit = alike + min(self.misfit(terms, shares) - alike, most_misfit(self.design, left))
        return self._smallest_gain + ODDS + misfit

    def misfit(self, terms: Sequence[PlacedTerm], shares: Sequence[Array]) -> float:
        """Return the sum of the misfits of the terms, and of the memories that were undone."""
        return self._undone_misfit + sum(self.tolerated_loss(*each) for each in zip(terms, shares, strict=True))

    def tolerated_loss(self, candidate: PlacedTerm, shares: Array) -> float:
        """Return the misfit of the candidate."""
        own = self.design.gram[np.ix_(candidate.columns, candidate.columns)]
        return candidate.term.misfit_of(candidate.term.is_of_load) * float(shares @ own @ shares)
