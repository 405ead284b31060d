"""Subset selection: the set of candidates with the highest score on one recording.

The score of a set is its gain, the reduction of the squared residual, minus its penalty (`penalties.py`), both in
variances of the noise. The search is a forward selection with a beam; after every step it tries to remove and to
exchange the candidates of a set (similar to the floating search of Pudil, Novovičová & Kittler, Pattern Recognit. Lett.
15 (1994) 1119).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic

import numpy as np
from numpy.typing import NDArray

from ...physics.effect import Where
from ...physics.law import Array
from ..model.regression import D, PlacedTerm
from ..model.solve import RIDGE, is_possible, solve_shares, with_ridge
from .penalties import penalties_of

BEAM = 3  # sets that every step extends, and extended sets in which it tries to remove and to exchange candidates
TRIED = 12  # exchanges that are tried for a candidate
GOOD_FIT = 1.15  # squared residual of a good fit, relative to the noise
LEAST_OF_REST = 0.05  # of the residual beyond the noise: a step with a smaller gain ends the search
SHORTLIST = 40  # candidates that are solved exactly in a step: those with the highest approximate gains
SCALES = ("gain", "stiffening", "bit_shift")
LATE = ("delay", "lag")
LOST_BY_LIKE = 0.12  # of a memory's gain, by another that is as likely: materials follow these laws only approximately


@dataclass(frozen=True, slots=True, eq=False)
class FittedSet:
    """A set of candidates with its fit."""

    chosen: tuple[int, ...]  # numbers of the candidates, sorted
    shares: tuple[Array, ...]  # (k,) for each candidate with k columns
    gain: float  # reduction of the squared residual, variances of the noise
    score: float  # gain minus penalty; -inf if the set is no valid model


class SubsetSearch(Generic[D]):
    """Search on one design; fitted sets are cached."""

    def __init__(self, design: D, excluded_words: frozenset[str] = frozenset(), is_last: bool = False) -> None:
        """Prepare the search; `excluded_words` are in no set, because the timing of the design describes them.

        `is_last`: the timing is found. Before, a second memory could describe what a delay or lag does, so what a set
        leaves does not limit the misfit of its laws.
        """
        self.design, self.excluded_words, self.is_last = design, excluded_words, is_last
        self.penalties = penalties_of(design)
        self._fitted: dict[tuple[int, ...], FittedSet] = {}
        self._shortlists: dict[tuple[int, ...], list[int]] = {}
        self._starts = np.array([candidate.columns[0] for candidate in design.candidates])
        self._joint = self._joint_candidates()
        kinds = {"free": 0, "positive": 1, "whole": 2}
        self._kind = np.concatenate([np.full(len(c.columns), kinds[c.term.share]) for c in design.candidates])
        self._complexity_penalties = np.array(
            [self.penalties.complexity_penalty(candidate) for candidate in design.candidates]
        )

        self._with_mean_curve = [
            k for k, candidate in enumerate(design.candidates) if "mean_curve" in candidate.companion_words
        ]

    def run(self, start: Sequence[int] = ()) -> list[FittedSet]:
        """Return the sets of the beams, the highest score first; the empty set is one of them.

        `start`: candidates of the set from which the search begins.
        """
        empty = self.fit(())
        first = self._improve(self.fit(start)) if start else empty
        beam: list[FittedSet] = [first]
        best: dict[tuple[int, ...], FittedSet] = {(): empty, first.chosen: first}
        for _ in range(self.penalties.most_terms - len(first.chosen)):
            extended = {larger.chosen: larger for smaller in beam for larger in self._extensions(smaller)}
            promising = sorted(extended.values(), key=lambda fitted: -fitted.score)[:BEAM]
            grown = {improved.chosen: improved for improved in map(self._improve, promising)}
            if not grown:
                break
            previous = max(fitted.score for fitted in beam)
            gained = max(fitted.gain for fitted in beam)
            beam = sorted(grown.values(), key=lambda fitted: -fitted.score)
            best.update({fitted.chosen: fitted for fitted in beam})
            gained = beam[0].gain - gained
            rest = self.design.total - beam[0].gain - self.design.noise
            if beam[0].score <= previous or gained < LEAST_OF_REST * rest:
                break
        return sorted(best.values(), key=lambda fitted: -fitted.score)

    def fit(self, chosen: Sequence[int]) -> FittedSet:
        """Return the fit of the candidates numbered `chosen`."""
        key = tuple(sorted(chosen))
        if key not in self._fitted:
            every = [self.design.candidates[k] for k in key]
            shares, gain = solve_shares(self.design, every) if _is_a_model(every) else ((), 0.0)
            possible = len(shares) == len(every) and is_possible(every, shares, self.design.load.is_known)
            left = self.design.total - gain if self.is_last else np.inf
            score = gain - self.penalties.set_penalty(key, every, shares, left) if possible else -np.inf
            self._fitted[key] = FittedSet(key, shares, gain, score)
        return self._fitted[key]

    def alternatives(self, best: FittedSet, position: int, share: float) -> list[tuple[str, float]]:
        """Return words that may replace the candidate at `position` in `best`, with the loss of score, smallest first.

        The loss is less than `share` times the least gain of the candidate.
        """
        within = share * self.penalties.least_gain(best.chosen[position])
        rest = [k for k in best.chosen if k != best.chosen[position]]
        own = self.design.candidates[best.chosen[position]].word
        losses: dict[str, float] = {}
        for k in self._shortlist(rest):
            word = self.design.candidates[k].word
            if word == own or k in rest or own in self.design.candidates[k].term.yields_to:
                continue  # a term that yields to this one is a wider family and describes the same effect
            loss = best.score - self.fit([*rest, k]).score
            if loss < within and loss < losses.get(word, np.inf):
                losses[word] = loss
        return sorted(losses.items(), key=lambda item: item[1])

    def memories_alike(self, best: FittedSet, position: int) -> list[str]:
        """Return memories that explain nearly as much as the one at `position`, at its place, the best first."""
        rest = [k for k in best.chosen if k != best.chosen[position]]
        replaced = self.design.candidates[best.chosen[position]]
        least = best.gain - LOST_BY_LIKE * (best.gain - self.fit(rest).gain)
        gains: dict[str, float] = {}
        for k, other in enumerate(self.design.candidates):
            if other.term.is_memory and other.word != replaced.word and other.where == replaced.where:
                fitted = self.fit([*rest, k])
                if np.isfinite(fitted.score) and fitted.gain > max(least, gains.get(other.word, 0.0)):
                    gains[other.word] = fitted.gain
        return sorted(gains, key=lambda word: -gains[word])

    def simplify(self, best: FittedSet, share: float) -> FittedSet:
        """Return `best` with terms replaced by preferred ones (Term.yields_to) if the score falls little.

        It may fall by `share` times the least gain of the term, plus the tolerated loss of its law.
        """
        current = best
        for k in best.chosen:
            if k not in current.chosen:  # replaced together with an earlier one, by a term at a larger place
                continue
            candidate = self.design.candidates[k]
            rest = [j for j in current.chosen if j != k]
            others = [
                j
                for j in self._shortlist(rest)
                if self.design.candidates[j].word in candidate.term.yields_to and j not in rest
            ]
            own_shares = current.shares[current.chosen.index(k)]
            loss = share * self.penalties.least_gain(k) + self.penalties.tolerated_loss(candidate, own_shares)
            least = max(current.score - loss, self.fit(rest).score)
            replaced = (self.fit([*self._compatible(rest, j), j]) for j in others)
            near = [fitted for fitted in replaced if fitted.score > least]
            if near:
                current = max(near, key=lambda fitted: fitted.score)
        return current

    def _compatible(self, chosen: Sequence[int], k: int) -> list[int]:
        """Return `chosen` without candidates that have the word of candidate `k` at an overlapping place."""
        own = self.design.candidates[k]
        others = [(j, self.design.candidates[j]) for j in chosen]
        return [j for j, other in others if other.word != own.word or not overlap(other.where, own.where)]

    def margin(self, best: FittedSet, position: int) -> float:
        """Return the loss of score of the best set without the word of the candidate at `position` in `best`.

        The candidate is left out or replaced by one with another word. In units of its least gain; 0 if `best` is no
        valid model.
        """
        if not np.isfinite(best.score):
            return 0.0
        own = self.design.candidates[best.chosen[position]].word
        rest = [k for k in best.chosen if k != best.chosen[position]]
        others = [self.fit(rest).score]
        others += [
            self.fit([*rest, k]).score
            for k in self._shortlist(rest)
            if self.design.candidates[k].word != own and k not in rest
        ]
        return float(best.score - max(others)) / self.penalties.least_gain(best.chosen[position])

    def singles(self) -> list[FittedSet]:
        """Return the sets of one candidate, of all candidates on the shortlist."""
        return [self.fit((k,)) for k in self._shortlist(())]

    def _extensions(self, start: FittedSet) -> list[FittedSet]:
        """Return the best sets of `start` and one more candidate: BEAM sets, at most one for each added word."""
        words = {(self.design.candidates[k].word, self.design.candidates[k].where) for k in start.chosen}
        added = []
        for k in self._shortlist(start.chosen):
            candidate = self.design.candidates[k]
            if k in start.chosen or (candidate.word, candidate.where) in words:
                continue
            if candidate.where.scope != "insole" and (candidate.word, type(candidate.where)()) in words:
                continue
            added.append(k)
        # One set for each word: otherwise the beam would hold one term at three places.
        best: dict[str, FittedSet] = {}
        for k, bound in self._by_bound(start.chosen, added):
            least = sorted((fitted.score for fitted in best.values()), reverse=True)[BEAM - 1 : BEAM]
            if least and bound <= least[0]:
                break
            fitted = self.fit([*start.chosen, k])
            word = self.design.candidates[k].word
            if np.isfinite(fitted.score) and (word not in best or fitted.score > best[word].score):
                best[word] = fitted
        return sorted(best.values(), key=lambda fitted: -fitted.score)[:BEAM]

    def _improve(self, start: FittedSet) -> FittedSet:
        """Return `start` with candidates removed or exchanged as long as the score rises, at most four times."""
        current = start
        for _ in range(4):
            smaller = (self.fit([j for j in current.chosen if j != k]) for k in current.chosen)
            better = max([current, *smaller], key=lambda fitted: fitted.score)
            for k in current.chosen:
                rest = [j for j in current.chosen if j != k]
                if not rest:
                    continue
                for j, bound in self._by_bound(rest, [j for j in self._shortlist(rest)[:TRIED] if j not in rest]):
                    if bound <= better.score:
                        break
                    better = max(better, self.fit([*rest, j]), key=lambda fitted: fitted.score)
            if better.score <= current.score + 1e-6:
                break
            current = better
        return current

    def _by_bound(self, rest: Sequence[int], added: Sequence[int]) -> list[tuple[int, float]]:
        """Return the candidates `added`, each with an upper bound of its score beside `rest`, the highest bound first.

        The bound is the gain with free shares, and with companions without priors, less the penalties of the terms
        without the misfit of their laws.
        """
        if not added:
            return []
        gain, more = self._gains_with_companions(rest, added)
        gain -= sum(self.penalties.least_penalty(k) for k in rest)
        bounds = [(k, gain + own - self.penalties.least_penalty(k)) for k, own in zip(added, more, strict=True)]
        return sorted(bounds, key=lambda bound: -bound[1])

    def _gains_with_companions(self, rest: Sequence[int], added: Sequence[int]) -> tuple[float, list[float]]:
        """Return what the candidates `rest` explain together, and what each of `added` explains beyond that.

        All shares and companions are free, so these are upper bounds. No candidate explains less than nothing, but the
        matrix of a walk, from which the noise of its columns is subtracted, may not be positive.
        """
        design = self.design
        is_own = np.zeros(len(design.cross), bool)
        for k in rest:
            is_own[self._with_companions(k)] = True
        others = [columns[~is_own[columns]] for columns in map(self._with_companions, added)]
        is_new = np.zeros_like(is_own)
        is_new[np.concatenate(others)] = True
        own, new = np.flatnonzero(is_own), np.flatnonzero(is_new)
        taken = with_ridge(design.gram[own[:, None], own])
        between = design.gram[own[:, None], new]
        solved = np.linalg.solve(taken, np.column_stack([between, design.cross[own]]))
        cross = design.cross[new] - between.T @ solved[:, -1]
        gains = []
        for columns in others:
            at = np.searchsorted(new, columns)
            gram = with_ridge(design.gram[columns[:, None], columns]) - between[:, at].T @ solved[:, at]
            gains.append(max(float(cross[at] @ np.linalg.solve(gram, cross[at])), 0.0))
        return float(design.cross[own] @ solved[:, -1]), gains

    def _with_companions(self, k: int) -> NDArray[np.intp]:
        """Return the numbers of the columns of candidate `k` and of its companions."""
        return np.append(self.design.candidates[k].columns, self.design.candidates[k].companions)

    def _shortlist(self, chosen: Sequence[int]) -> list[int]:
        """Return up to SHORTLIST candidates by their approximate gain beside `chosen` less penalty, highest first."""
        taken = self.fit(chosen)
        if taken.chosen not in self._shortlists:
            self._shortlists[taken.chosen] = self._shortlist_beside(taken)
        return self._shortlists[taken.chosen]

    def _shortlist_beside(self, taken: FittedSet) -> list[int]:
        """Return the shortlist beside a fitted set.

        The gain is that of a candidate with free shares on the residual of the set. Companions are left out unless one
        is a mean curve, which may explain most. At most six candidates have the same word.
        """
        design = self.design
        columns = np.concatenate([design.candidates[k].columns for k in taken.chosen] or [np.empty(0, np.intp)])
        shares = np.concatenate([*taken.shares, np.empty(0)])
        kind, own_square = self._kind, design.gram.diagonal()
        products = design.gram[columns]
        cross = design.cross - shares @ products
        own = products[:, columns] + np.diag(RIDGE * own_square[columns] + 1e-12)
        left = own_square - np.einsum("ij,ij->j", products, np.linalg.solve(own, products))
        diagonal = np.maximum(left, 1e-3 * own_square + 1e-12)
        per_column = np.where(kind == 1, np.maximum(cross, 0.0), cross) ** 2 / diagonal
        per_column = np.where(kind == 2, 2 * cross - own_square, per_column)
        gains = np.add.reduceat(per_column, self._starts) - self._complexity_penalties
        for numbers, columns_of, inverses in self._joint:
            r = cross[columns_of]
            bound = np.einsum("mi,mij,mj->m", r, inverses, r) - self._complexity_penalties[numbers]
            gains[numbers] = np.minimum(gains[numbers], bound)
        if curved := [k for k in self._with_mean_curve if k not in taken.chosen]:
            gains[curved] = self._gains_with_companions(taken.chosen, curved)[1]
            gains[curved] -= self._complexity_penalties[curved]
        order: list[int] = np.argsort(-gains)[: 6 * SHORTLIST].tolist()
        n_of_word: dict[str, int] = {}
        shortlist = []
        for k in order:
            word = design.candidates[k].word
            n_of_word[word] = n_of_word.get(word, 0) + 1
            if (
                n_of_word[word] <= 6
                and gains[k] > 0
                and word not in self.excluded_words
                and not design.candidates[k].term.is_internal
            ):
                shortlist.append(k)
        return shortlist[:SHORTLIST]

    def _joint_candidates(self) -> list[tuple[NDArray[np.intp], NDArray[np.intp], Array]]:
        """Return, for each k > 1, the numbers (m,) of candidates with k columns, their columns, and inverses.

        Columns are (m, k), the inverses of their Gram matrices (m, k, k).
        """
        joint = []
        sizes = np.array([len(candidate.columns) for candidate in self.design.candidates])
        for k in np.unique(sizes[sizes > 1]).tolist():
            numbers = np.flatnonzero(sizes == k)
            columns = np.stack([self.design.candidates[n].columns for n in numbers])
            own = self.design.gram[columns[:, :, None], columns[:, None, :]]
            own = own + (RIDGE * np.einsum("mkk->mk", own) + 1e-12)[..., None] * np.eye(k)
            joint.append((numbers, columns, np.linalg.inv(own)))
        return joint


def _is_a_model(chosen: Sequence[PlacedTerm]) -> bool:
    """Return whether a set can be a model.

    It is not if all boards are late, one of them by a delay or lag, because that is a timing of the whole insole, of
    which the viscoelasticity of a board can be a part; if a bit shift and a gain overlap; if all boards have a bit
    shift and the insole has a memory, because the shift would multiply the memory; if terms computed from the reference
    stand beside terms that change the whole load, because the columns of the former then contain the error; or if a
    word is twice at one place.
    """
    late = [term for term in chosen if term.word in (*LATE, "viscoelasticity") and term.where.scope == "board"]
    if any(term.word in LATE for term in late) and len({term.where for term in late}) == late[0].n_places:
        return False
    exact = [term for term in chosen if term.word == "bit_shift"]
    if any(overlap(shift.where, term.where) for shift in exact for term in chosen if term.word == "gain"):
        return False  # a bit shift is exactly a gain of a power of two
    if any(shift.where.scope == "insole" for shift in exact) and any(_is_memory_of_insole(term) for term in chosen):
        return False
    if any(placed.term.is_of_load for placed in chosen) and any(_changes_load(placed) for placed in chosen):
        return False
    return not any(
        one.word == other.word and overlap(one.where, other.where)
        for i, one in enumerate(chosen)
        for other in chosen[:i]
    )


def _changes_load(candidate: PlacedTerm) -> bool:
    """Return whether a term changes the readings of the insole or of a board in proportion to the load."""
    if candidate.word in SCALES:
        return candidate.where.scope in ("insole", "board")
    return _is_memory_of_insole(candidate) and not candidate.term.is_of_load


def _is_memory_of_insole(candidate: PlacedTerm) -> bool:
    return candidate.term.is_memory and candidate.where.scope == "insole"


def overlap(one: Where, other: Where) -> bool:
    """Return whether two places have triangles in common."""
    if "insole" in (one.scope, other.scope):
        return True
    depth = min(len(one.ids[0]), len(other.ids[0]))
    return bool({identity[:depth] for identity in one.ids} & {identity[:depth] for identity in other.ids})
