"""Which physics was left out: every subset of the candidates, and the price of one more.

What a hypothesis leaves is measured as a share of what the static model leaves above the noise: u = 1 explains nothing,
0 everything. One more effect has to take away a share of the whole and most of what the smaller set left: a family of
curves never is the material's own, and what is left of a strong effect for that reason is not another effect. Because u
is relative the rule is the same at every magnitude.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ..physics.law import Array
from .candidate import Candidate
from .fit import Evidence, Fitted, Hypothesis
from .strengths import freed

MOST_EFFECTS = 3
# What one more effect has to take away: of the whole excess, and of what the smaller set leaves. A small one has to
# explain nearly all that is left.
PRICES = ((0.04, 0.5), (0.008, 0.8))
AS_GOOD = 1.6  # times what the best subset leaves: a swap that leaves less is as good
LEAST_FITTED = 0.3  # of what the smaller set leaves, that has to go on the blocks that were fitted to as well
FIRST_STEPS = 4  # that every subset is fitted for
FITTED = 12  # subsets of each size that are fitted to the end
KEPT = 6  # subsets of each size that are tried with blocks held out
N_FOLDS = 5
FOLD_S = 8.0  # blocks of rows that are held out together: longer than most memory of the noise

Words = tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Tried:
    """One subset, fitted."""

    words: Words
    fitted: Fitted
    left: float  # u, on the blocks it was fitted to
    left_heldout: float = np.nan  # on blocks that were not
    thetas: Array | None = None  # (N_FOLDS, p) without each fold

    @property
    def std(self) -> Array:
        """(p,) of θ: the jackknife over folds, which sees what a family of curves leaves as well as noise."""
        assert self.thetas is not None
        spread = self.thetas - self.thetas.mean(axis=0)
        found: Array = np.sqrt((N_FOLDS - 1) / N_FOLDS * np.sum(spread**2, axis=0))
        return found


@dataclass(frozen=True, slots=True)
class Decoy:
    """A copy of the effect `word` that is no physics, in its place, and what the set then leaves."""

    word: str
    kind: str
    left: float  # on held-out blocks; where it is too much already, on those it was fitted to
    effect_left_heldout: float  # with the effect itself
    as_good: bool


@dataclass(frozen=True, slots=True, eq=False)
class Naming:
    """All subsets that were tried on one group of taxels."""

    floor: float  # mean square of the noise, in the units of the evidence
    excess: float  # mean square that the static model leaves above it
    null: Tried
    best: Tried
    tried: tuple[Tried, ...]
    decoys: tuple[Decoy, ...] = ()


def folds(evidence: Evidence) -> NDArray[np.intp]:
    """(n,) which of N_FOLDS a row is held out with: stretches of FOLD_S, in turn."""
    found = []
    for each in evidence.observed:
        t = each.t_s
        found.append(((t - t[0]) // FOLD_S).astype(np.intp) % N_FOLDS)
    return np.concatenate(found)


def left(fitted: Fitted, evidence: Evidence, floor: float, excess: float) -> float:
    """u of the blocks it was fitted to, each reading with strengths of its own."""
    return (freed(Hypothesis(evidence, fitted.candidates), fitted).mean_square() - floor) / excess


def heldout(tried: Fitted, evidence: Evidence, load_pa: Array) -> tuple[float, Array]:
    """Mean square over rows that are each predicted by a fit that has not seen its fold, and the θ of these fits.

    Rows whose load `load_pa` (n,) lies beyond that of the rows fitted to are not asked: what a free curve says there is
    no matter of the hypothesis.
    """
    hypothesis = Hypothesis(evidence, tried.candidates)
    fold = folds(evidence)
    total, asked, thetas = 0.0, 0, []
    for i in range(N_FOLDS):
        fitted_to = fold != i
        low, high = load_pa[fitted_to].min(), load_pa[fitted_to].max()
        out = ~fitted_to & (load_pa >= low) & (load_pa <= high)
        fitted = freed(hypothesis, hypothesis.fit(tried.theta, fitted_to, 3))
        total += float(np.sum(fitted.residual[out] ** 2))
        asked += fitted.residual[out].size
        thetas.append(fitted.theta)
    return total / max(asked, 1), np.stack(thetas)


def name(evidence: Evidence, candidates: Mapping[str, Candidate], floor: float, deadline: float) -> Naming:
    """Try every subset of the `candidates` that could win, up to MOST_EFFECTS of them, and choose.

    `deadline` (monotonic): no larger subsets are begun after it.
    """
    null = Hypothesis(evidence, ()).fit()
    excess = max(null.mean_square() - floor, 1e-12)
    load_pa = null.effective_pa.mean(axis=1)

    def judge(tried: Tried) -> Tried:
        mean_square, thetas = heldout(tried.fitted, evidence, load_pa)
        return replace(tried, left_heldout=(mean_square - floor) / excess, thetas=thetas)

    by_words: dict[Words, Tried] = {(): Tried((), null, 1.0)}
    judged: dict[Words, Tried] = {(): judge(by_words[()])}
    best = judged[()]
    for size in range(1, MOST_EFFECTS + 1):
        # What is left is less than one more effect costs: no larger set could win.
        if best.left_heldout <= PRICES[-1][0] or (size > 1 and time.monotonic() > deadline):
            break
        # All are begun; those that come nearest are fitted to the end.
        begun = [_begun(evidence, candidates, words, by_words) for words in combinations(candidates, size)]
        begun.sort(key=lambda fitted: fitted.cost)
        for fitted in [*(_finished(evidence, each) for each in begun[:FITTED]), *begun[FITTED:]]:
            by_words[fitted.words] = Tried(fitted.words, fitted, left(fitted, evidence, floor, excess))
        promising = sorted((t for t in by_words.values() if len(t.words) == size), key=lambda t: t.left)[:KEPT]
        judged |= {tried.words: judge(tried) for tried in promising}
        best = cheapest(judged.values())
        for smaller in _without_one(evidence, candidates, best):
            # A larger set may find its way where a smaller one was stuck: that one is tried from there again.
            known = by_words[smaller.words]
            if smaller.cost < known.fitted.cost:
                better = Tried(smaller.words, smaller, left(smaller, evidence, floor, excess))
                by_words[better.words], judged[better.words] = better, judge(better)
        best = cheapest(judged.values())
    return Naming(floor, excess, judged[()], best, tuple(judged.values()))


def cheapest(judged: Collection[Tried]) -> Tried:
    """The smallest set, of these with the empty one, that no larger one is worth its price beside."""
    best = next(each for each in judged if not each.words)
    for size in range(1, max(len(each.words) for each in judged) + 1):
        of_size = [each for each in judged if len(each.words) == size]
        challenger = _in_its_words(min(of_size, key=_left, default=best), of_size)
        if worth(best, challenger):
            best = challenger
    return best


def _in_its_words(tried: Tried, of_size: Collection[Tried]) -> Tried:
    """`tried`, or of its size what says the same in its own words: a family's edge is not told as that family."""
    values = zip(tried.fitted.candidates, tried.fitted.values(), strict=True)
    really = {candidate.is_really(own) for candidate, own in values}
    for each in of_size:
        if set(each.words) == really and _left(each) <= AS_GOOD * _left(tried):
            return each
    return tried


def _without_one(evidence: Evidence, candidates: Mapping[str, Candidate], tried: Tried) -> list[Fitted]:
    """The sets one smaller, fitted from where `tried` is."""
    found = []
    values = {c.word: own for c, own in zip(tried.fitted.candidates, tried.fitted.values(), strict=True)}
    for left_out in tried.words if len(tried.words) > 1 else ():
        hypothesis = Hypothesis(evidence, [candidates[word] for word in tried.words if word != left_out])
        own = [values[each.word] for each in hypothesis.candidates]
        fitted = hypothesis.fit(np.concatenate([tried.fitted.clocks().ravel(), *own]))
        found.append(hypothesis.polished(fitted))
    return found


def _left(tried: Tried) -> float:
    return tried.left_heldout


def worth(smaller: Tried, larger: Tried) -> bool:
    """Whether what the larger set has more is worth its price."""
    more = len(larger.words) - len(smaller.words)
    before = min(max(_left(smaller), 0.0), 1.0)  # more than the whole is what a curve invents where it has to guess
    gain = before - _left(larger)
    if smaller.left - larger.left < LEAST_FITTED * smaller.left:
        return False  # it makes the fit of what the smaller set has steadier, and adds nothing
    return any(gain > price * more and gain > (1 - (1 - share) ** more) * before for price, share in PRICES)


def _begun(
    evidence: Evidence, candidates: Mapping[str, Candidate], words: Words, by_words: Mapping[Words, Tried]
) -> Fitted:
    """`words` after a few steps from the subsets one smaller, each with the best start of the word it lacks."""
    hypothesis = Hypothesis(evidence, [candidates[word] for word in words])
    parents = [(by_words[tuple(w for w in words if w != word)], word) for word in words]
    parents.sort(key=lambda each: each[0].left)
    starts = [start for parent, word in parents[:2] for start in _starts(hypothesis, parent.fitted, candidates[word])]
    # The last try begins with the clocks as their edges agree: a smaller set may have bent them.
    starts.append(starts[0].copy())
    starts[-1][: 2 * len(evidence.observed) * evidence.own_clock] = 0.0
    if not evidence.own_clock:
        starts.pop()
    return min((hypothesis.fit(start, most_steps=FIRST_STEPS) for start in starts), key=lambda fitted: fitted.cost)


def _finished(evidence: Evidence, begun: Fitted) -> Fitted:
    hypothesis = Hypothesis(evidence, begun.candidates)
    return hypothesis.polished(hypothesis.fit(begun.theta))


def _starts(hypothesis: Hypothesis, parent: Fitted, added: Candidate) -> list[Array]:
    """θ to begin with: the parent's, and starts of the added one; where slopes mislead, several."""
    clocks = parent.clocks().ravel()
    own = {c.word: values for c, values in zip(parent.candidates, parent.values(), strict=True)}
    several = 3 if added.nudge is not None and not parent.candidates else 1
    found = []
    for start in hypothesis.promising(parent, added, several):
        own[added.word] = start
        found.append(np.concatenate([clocks, *(own[each.word] for each in hypothesis.candidates)]))
    return found
