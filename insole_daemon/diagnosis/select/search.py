"""The set of candidates that explains a recording best for its price.

A set's score is the squared residual it takes away less the penalties of its candidates. The search goes forward with a
beam, and after every step tries to leave out and to exchange what is in a set.
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
from ..model.solve import RIDGE, is_possible, solve_shares
from .prices import prices_of

BEAM = 3
TRIED = 12  # exchanges of a candidate
LEAST_OF_REST = 0.05  # of what a set leaves beyond the noise: a step that explains less ends the search
SHORTLIST = 40  # candidates a step that are solved exactly, after a bound on what each can gain
SCALES = ("gain", "stiffening", "bit_shift")
LATE = ("delay", "lag")


@dataclass(frozen=True, slots=True, eq=False)
class FittedSet:
    """A set of candidates, fitted."""

    chosen: tuple[int, ...]  # candidates' numbers, sorted
    shares: tuple[Array, ...]  # of each
    gain: float  # squared residual taken away
    score: float  # less penalties


class SubsetSearch(Generic[D]):
    """All sets that were fitted on one design."""

    def __init__(self, design: D, barred: frozenset[str] = frozenset()) -> None:
        """`barred`: words that no set may have, because the timing of the design stands for them."""
        self.design, self.barred = design, barred
        self.prices = prices_of(design)
        self.noise = float(np.count_nonzero(design.weights))  # squared sum of what noise alone leaves
        self._fitted: dict[tuple[int, ...], FittedSet] = {}
        self._starts = np.array([each.columns[0] for each in design.candidates])
        self._joint = self._joint_candidates()
        kinds = {"free": 0, "positive": 1, "whole": 2}
        self._kind = np.concatenate([np.full(len(c.columns), kinds[c.term.share]) for c in design.candidates])
        self._surcharges = np.array([self.prices.surcharge(each) for each in design.candidates])

    def run(self) -> list[FittedSet]:
        """The best sets, best first; the empty one is among them."""
        empty = self.fit(())
        beam: list[FittedSet] = [empty]
        best: dict[tuple[int, ...], FittedSet] = {(): empty}
        for _ in range(self.prices.most_terms):
            grown: dict[tuple[int, ...], FittedSet] = {}
            for start in beam:
                for found in self._grow(start)[: BEAM + 2]:
                    polished = self._polish(found)
                    grown[polished.chosen] = polished
            if not grown:
                break
            previous = max(each.score for each in beam)
            gained = max(each.gain for each in beam)
            beam = sorted(grown.values(), key=lambda each: -each.score)[:BEAM]
            best.update({each.chosen: each for each in beam})
            gained = beam[0].gain - gained
            if beam[0].score <= previous or gained < LEAST_OF_REST * (self.design.total - beam[0].gain - self.noise):
                break
        return sorted(best.values(), key=lambda each: -each.score)

    def fit(self, chosen: Sequence[int]) -> FittedSet:
        """The set `chosen`, with its score."""
        key = tuple(sorted(chosen))
        if key not in self._fitted:
            every = [self.design.candidates[k] for k in key]
            shares, gain = solve_shares(self.design, every) if _is_a_model(every) else ((), 0.0)
            possible = len(shares) == len(every) and is_possible(every, shares, self.design.load.is_known)
            score = gain - self.prices.of_set(key, every, shares) if possible else -np.inf
            self._fitted[key] = FittedSet(key, shares, gain, score)
        return self._fitted[key]

    def alternatives(self, best: FittedSet, position: int, share: float) -> list[tuple[str, float]]:
        """Words that may stand in the place of one candidate of `best`, with how much worse the set is then.

        By less than a `share` of the least that the candidate has to gain.
        """
        within = share * self.prices.least(best.chosen[position])
        rest = [k for k in best.chosen if k != best.chosen[position]]
        own = self.design.candidates[best.chosen[position]].word
        found: dict[str, float] = {}
        for k in self._short(rest):
            word = self.design.candidates[k].word
            if word == own or k in rest or own in self.design.candidates[k].term.yields_to:
                continue  # what yields to it is a wider family, and describes it, too
            worse = best.score - self.fit([*rest, k]).score
            if worse < within and worse < found.get(word, np.inf):
                found[word] = worse
        return sorted(found.items(), key=lambda item: item[1])

    def simplified(self, best: FittedSet, share: float) -> FittedSet:
        """`best` with terms exchanged for likelier ones that explain as much, but for their misfit and for a `share`
        of the least that a term has to gain.
        """
        current = best
        for k in best.chosen:
            if k not in current.chosen:  # a likelier term at a larger place has taken it in
                continue
            candidate = self.design.candidates[k]
            rest = [j for j in current.chosen if j != k]
            others = [
                j
                for j in self._short(rest)
                if self.design.candidates[j].word in candidate.term.yields_to and j not in rest
            ]
            own_shares = current.shares[current.chosen.index(k)]
            loss = share * self.prices.least(k) + self.prices.loose(candidate, own_shares)
            least = max(current.score - loss, self.fit(rest).score)
            near = [each for each in (self.fit([*self._beside(rest, j), j]) for j in others) if each.score > least]
            if near:
                current = max(near, key=lambda each: each.score)
        return current

    def _beside(self, chosen: Sequence[int], k: int) -> list[int]:
        """Of `chosen` what can stand beside candidate `k`: its own word at a part of its place is a part of it."""
        own = self.design.candidates[k]
        every = [(j, self.design.candidates[j]) for j in chosen]
        return [j for j, each in every if each.word != own.word or not _overlap(each.where, own.where)]

    def margin(self, best: FittedSet, position: int) -> float:
        """How much worse the best set without this candidate's word is, with anything else in its place or nothing.

        In units of the least that the candidate has to gain; 0 of a set that makes no sense.
        """
        if not np.isfinite(best.score):
            return 0.0
        own = self.design.candidates[best.chosen[position]].word
        rest = [k for k in best.chosen if k != best.chosen[position]]
        others = [self.fit(rest).score]
        others += [
            self.fit([*rest, k]).score
            for k in self._short(rest)
            if self.design.candidates[k].word != own and k not in rest
        ]
        return float(best.score - max(others)) / self.prices.least(best.chosen[position])

    def singles(self) -> list[FittedSet]:
        """Sets of one candidate."""
        return [self.fit((k,)) for k in self._short(())]

    def _grow(self, start: FittedSet) -> list[FittedSet]:
        words = {(self.design.candidates[k].word, self.design.candidates[k].where) for k in start.chosen}
        found = []
        for k in self._short(start.chosen):
            candidate = self.design.candidates[k]
            if k in start.chosen or (candidate.word, candidate.where) in words:
                continue
            if candidate.where.scope != "insole" and (candidate.word, type(candidate.where)()) in words:
                continue
            found.append(self.fit([*start.chosen, k]))
        found = [each for each in found if np.isfinite(each.score)]
        # One of each word: a beam of three places of one term would be no beam.
        best: dict[str, FittedSet] = {}
        for each in sorted(found, key=lambda each: -each.score):
            new = (set(each.chosen) - set(start.chosen)).pop()
            best.setdefault(self.design.candidates[new].word, each)
        return list(best.values())

    def _polish(self, start: FittedSet) -> FittedSet:
        """`start` with candidates left out or exchanged as long as that helps."""
        current = start
        for _ in range(4):
            options = [self.fit([j for j in current.chosen if j != k]) for k in current.chosen]
            for k in current.chosen:
                rest = [j for j in current.chosen if j != k]
                if rest:
                    options += [self.fit([*rest, j]) for j in self._short(rest)[:TRIED] if j not in rest]
            better = max(options, key=lambda each: each.score, default=current)
            if better.score <= current.score + 1e-6:
                break
            current = better
        return current

    def _short(self, chosen: Sequence[int]) -> list[int]:
        """Candidates by what each gains beside `chosen` without bounds on its shares, the most first."""
        design = self.design
        taken = self.fit(chosen)
        columns = np.concatenate([design.candidates[k].columns for k in taken.chosen] or [np.empty(0, np.intp)])
        shares = np.concatenate([*taken.shares, np.empty(0)])
        left = design.cross - design.gram[:, columns] @ shares
        if len(columns):
            own = design.gram[np.ix_(columns, columns)]
            own = own + np.diag(RIDGE * np.diag(own) + 1e-12)
            through = np.linalg.solve(own, design.gram[columns])
            diagonal = design.gram.diagonal() - np.einsum("ij,ij->j", design.gram[columns], through)
        else:
            diagonal = design.gram.diagonal().copy()
        diagonal = np.maximum(diagonal, 1e-3 * design.gram.diagonal() + 1e-12)
        kind, own_square = self._kind, design.gram.diagonal()
        per_column = np.where(kind == 1, np.maximum(left, 0.0), left) ** 2 / diagonal
        per_column = np.where(kind == 2, 2 * left - own_square, per_column)
        gains = np.add.reduceat(per_column, self._starts) - self._surcharges
        for numbers, columns_of, inverses in self._joint:
            r = left[columns_of]
            bound = np.einsum("mi,mij,mj->m", r, inverses, r) - self._surcharges[numbers]
            gains[numbers] = np.minimum(gains[numbers], bound)
        order: list[int] = np.argsort(-gains)[: 6 * SHORTLIST].tolist()
        # The best few of every word, and the best of all.
        seen: dict[str, int] = {}
        short = []
        for k in order:
            word = design.candidates[k].word
            seen[word] = seen.get(word, 0) + 1
            if (
                seen[word] <= 6
                and gains[k] > 0
                and word not in self.barred
                and not design.candidates[k].term.is_internal
            ):
                short.append(k)
        return short[:SHORTLIST]

    def _joint_candidates(self) -> list[tuple[NDArray[np.intp], NDArray[np.intp], Array]]:
        """Of candidates with k > 1 columns, by k: their m numbers, their columns (m, k), and inverses (m, k, k)."""
        found = []
        sizes = np.array([len(each.columns) for each in self.design.candidates])
        for k in np.unique(sizes[sizes > 1]).tolist():
            numbers = np.flatnonzero(sizes == k)
            columns = np.stack([self.design.candidates[n].columns for n in numbers])
            own = self.design.gram[columns[:, :, None], columns[:, None, :]]
            own = own + (RIDGE * np.einsum("mkk->mk", own) + 1e-12)[..., None] * np.eye(k)
            found.append((numbers, columns, np.linalg.inv(own)))
        return found


def _is_a_model(chosen: Sequence[PlacedTerm]) -> bool:
    """Whether no term stands twice at a place, no bits are shifted by a part, and not all boards are late.

    Readings of all boards that come late are late on the whole insole: that is a timing of the reference.
    """
    late = [each for each in chosen if each.word in LATE and each.where.scope == "board"]
    if late and len({each.where for each in late}) == late[0].n_places:
        return False
    exact = [each for each in chosen if each.word == "bit_shift"]
    if any(_overlap(one.where, each.where) for one in exact for each in chosen if each.word == "gain"):
        return False  # a shift by bits is a gain of a power of two, and no other
    if any(each.term.is_of_load for each in chosen) and any(_stands_for_load(each) for each in chosen):
        return False  # what is made of the load differs from what is made of readings by the error itself
    return not any(
        one.word == other.word and _overlap(one.where, other.where)
        for i, one in enumerate(chosen)
        for other in chosen[:i]
    )


def _stands_for_load(each: PlacedTerm) -> bool:
    """Whether it changes the readings of a good part of the insole as a whole."""
    if each.word in SCALES:
        return each.where.scope in ("insole", "board")
    return each.term.is_memory and not each.term.is_of_load and each.where.scope == "insole"


def _overlap(one: Where, other: Where) -> bool:
    if "insole" in (one.scope, other.scope):
        return True
    depth = min(len(one.ids[0]), len(other.ids[0]))
    return bool({each[:depth] for each in one.ids} & {each[:depth] for each in other.ids})
