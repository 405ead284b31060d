"""Search for delay and lag of the whole insole: the best set of terms under each timing hypothesis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, Self

import numpy as np

from ..model.regression import D, Timing
from ..model.timing import MOST_S, START_S, TOLERANCE_S, fit_timing
from .search import FittedSet, SubsetSearch

ROUNDS = 4  # of fitting terms and timing in turn
NEAR = Timing(0.008, 0.03)  # smaller changes of the timing do not require new columns
NEARER = Timing(0.001, 0.004)  # the same for the final fit of the best hypothesis
CLEARLY_LESS = 0.8  # of the criterion beyond the noise: a lag and an earlier clock also describe much of a memory
CLEARLY_WORSE = 1.25  # criterion beyond the noise at an initial timing, of that without one: it misleads
EXPLAINS_MUCH = 0.5  # of the squared residual without terms: what a timing leaves that is fitted without terms


@dataclass(frozen=True, slots=True, eq=False)
class TimingHypothesis:
    """A hypothesis on the timing, with its fitted times."""

    words: tuple[str, ...]  # "delay", "lag", or "clock" where readings come early
    timing: Timing
    criterion: float  # squared residual plus penalties of its best set, variances of the noise
    left: float  # the squared residual alone
    n_terms: int  # those of its best set, and its words

    def beside(self, other: TimingHypothesis) -> Self:
        """Return the hypothesis with a criterion above that of `other`, if that leaves less with fewer terms.

        The smallest effect of a few triangles is smaller than that of the insole, so the penalties of a set of these
        can be smaller than that of a single effect of the insole.
        """
        if not (other.n_terms < self.n_terms and other.left < self.left):
            return self
        return replace(self, criterion=max(self.criterion, other.criterion + self.left - other.left))

    @property
    def hypothesis(self) -> TimingHypothesis:
        """Return the hypothesis without a search, whose design is large."""
        return TimingHypothesis(self.words, self.timing, self.criterion, self.left, self.n_terms)


@dataclass(frozen=True, slots=True, eq=False)
class TimingFit(TimingHypothesis, Generic[D]):
    """A timing hypothesis with its search and best set."""

    search: SubsetSearch[D]
    best: FittedSet

    def refitted(self, search: SubsetSearch[D], best: FittedSet) -> TimingFit[D]:
        """Return the hypothesis with another search and its best set, and the same penalty of its times."""
        more = (search.design.total - best.score) - (self.search.design.total - self.best.score)
        left, n_terms = search.design.total - best.gain, len(self.words) + len(best.chosen)
        return TimingFit(self.words, self.timing, self.criterion + more, left, n_terms, search, best)


def search_timings(
    make: Callable[[Timing], D], is_free_clock: bool, known: Sequence[TimingHypothesis] = ()
) -> tuple[TimingFit[D], tuple[TimingHypothesis, ...]]:
    """Return the timing hypothesis with the smallest criterion, and the other hypotheses, best first.

    The hypotheses are: none, delay, lag, both; and clock, if readings seem to come before their load because a
    declared clock is wrong. If the clock's offset is free (`is_free_clock`), a time shift is fitted in every
    hypothesis, so delay is none of them. `make` returns the design under the load after a timing: the columns of its
    terms are computed from the shifted and filtered load. `known`: hypotheses of a search on the same rows under other
    priors, whose times are the initial values.

    Designs are large: beside that of the first timing there is one at a time, and the best hypothesis is fitted again.
    """
    hypotheses: list[tuple[str, ...]] = [("lag",)] if is_free_clock else [("delay",), ("lag",)]
    first = make(Timing())
    before = {each.words: each.timing for each in known}
    best = _best_of(first, make, (), is_free_clock, before.get(()))
    # A set is the start of other searches only with the same columns.
    untimed = best if isinstance(best, TimingFit) and best.search.design.candidates is first.candidates else None
    others: list[TimingHypothesis] = []

    def add(words: tuple[str, ...], start: Timing | None = None) -> None:
        nonlocal best
        start = before.get(words, start)
        one = _best_of(first, make, words, is_free_clock, start, untimed)
        one, best = one.beside(best), best.beside(one)
        best, other = (one, best) if one.criterion < best.criterion else (best, one)
        others.append(other)
        alone = None if start is not None else _alone(first, one.timing, words, is_free_clock)
        if alone is None:
            return
        second = _best_of(first, make, words, is_free_clock, alone, untimed)
        if second.criterion - first.noise < CLEARLY_LESS * (best.criterion - first.noise):
            others[:] = [other for other in others if other.words != words]
            if best.words != words:
                others.append(best)
            best = second

    for words in hypotheses:
        add(words)
    if not is_free_clock:
        if best.words:
            add(("delay", "lag"))  # both together only if one of them lowers the criterion
        # The edges alone may not show a wrong clock beside a memory, so all rows are fitted.
        early = fit_timing(first, (), Timing(), *_freedom(("clock",), is_free_clock))
        if early.delay_s < -NEAR.delay_s:
            add(("clock",), early)
    others = [each.hypothesis.beside(best) for each in others]
    if best.words or not isinstance(best, TimingFit):
        reached = best
        del best, untimed
        best = _fit_again(reached, first, make, is_free_clock)
    return best, tuple(sorted(others, key=lambda each: each.criterion))


def _fit_again(reached: TimingHypothesis, first: D, make: Callable[[Timing], D], is_free_clock: bool) -> TimingFit[D]:
    """Return the fit of the hypothesis `reached`, with columns that are exact at its times."""
    free, within_s = _freedom(reached.words, is_free_clock)
    fitted = _fit_from(reached.timing, first, make, reached.words, free, within_s, NEARER)
    if not isinstance(fitted, TimingFit):
        fitted = _fit_from(fitted.timing, first, make, reached.words, (False, False), within_s, NEARER)
    assert isinstance(fitted, TimingFit)  # as with fixed times
    return without_short_lag(fitted)


def _best_of(
    first: D,
    make: Callable[[Timing], D],
    words: tuple[str, ...],
    is_free_clock: bool,
    start: Timing | None,
    untimed: TimingFit[D] | None = None,
) -> TimingHypothesis:
    """Return the hypothesis `words` as fitted from the timing `start` or from an estimate without terms.

    Only the hypothesis without words may keep its fit, a TimingFit. `untimed`: that fit, with the columns of `first`.
    """
    free, within_s = _freedom(words, is_free_clock)
    if start is None:
        start = _start(first, free, within_s, is_free_clock)
    fitted = _fit_from(start, first, make, words, free, within_s, untimed=untimed)
    if not words:
        return fitted
    if _is_short_lag(fitted, first):
        return TimingHypothesis(words, fitted.timing, np.inf, np.inf, fitted.n_terms)
    return fitted.hypothesis


def _alone(first: D, reached: Timing, words: tuple[str, ...], is_free_clock: bool) -> Timing | None:
    """Return the timing that is fitted without terms, if it explains far more than the timing `reached` with terms.

    Terms of the first round may hold back such a timing. None if it does not, or if the load is not uniform.
    """
    free, within_s = _freedom(words, is_free_clock)
    if not (first.load.observation.is_uniform and any(free)):
        return None
    alone = fit_timing(first, (), reached, free, within_s)
    return alone if first.retimed(alone).total < EXPLAINS_MUCH * first.retimed(reached).total else None


def without_short_lag(fitted: TimingFit[D]) -> TimingFit[D]:
    """Return a fit without the word of a lag that its last refinement made shorter than one that can be identified.

    Its times stay: they align.
    """
    is_short = _is_short_lag(fitted, fitted.search.design)
    return replace(fitted, words=tuple(set(fitted.words) - {"lag"})) if is_short else fitted


def _is_short_lag(fitted: TimingHypothesis, design: D) -> bool:
    return "lag" in fitted.words and fitted.timing.lag_s < design.load.observation.least_lag_s


def _freedom(words: tuple[str, ...], is_free_clock: bool) -> tuple[tuple[bool, bool], tuple[float, float]]:
    """Return whether delay and lag are free parameters, and the bounds of the delay, s."""
    free = ("delay" in words or "clock" in words or is_free_clock, "lag" in words)
    return free, (0.0 if "delay" in words else -MOST_S, 0.0 if "clock" in words else MOST_S)


def _fit_from(
    timing: Timing,
    first: D,
    make: Callable[[Timing], D],
    words: tuple[str, ...],
    free: tuple[bool, bool],
    within_s: tuple[float, float],
    near: Timing = NEAR,
    untimed: TimingFit[D] | None = None,
) -> TimingHypothesis:
    """Return the hypothesis that is reached from `timing` by fitting the terms and the times in turn.

    Columns are computed from the reference after a timing. They are computed again once the timing that is searched
    differs from that one by more than `near`. The result is a TimingFit, with its search, unless a round has a larger
    criterion than the round before. Then it is the hypothesis of the round before, without its search, which is freed
    by then. That happens because a delay of the whole insole and the same delay of every board look alike, and because
    linearised columns are wrong far from the timing they were computed for. `untimed`:
    the fit of the hypothesis without words. The search begins with its set while the columns are those of `first`, and
    with its timing, too, if it fits clearly better than `timing`.
    """
    # A clock term could compensate the delay of the hypothesis.
    excluded_words = frozenset({"clock"}) if "delay" in words or "clock" in words else frozenset()
    design, made_for = first, Timing()
    of_untimed = () if untimed is None else untimed.best.chosen
    of_first = known = tuple(k for k in of_untimed if first.candidates[k].word not in excluded_words)
    before: TimingHypothesis | None = None  # the round before
    least = first.total  # what it left
    is_last = not any(free)
    round_ = 0
    while True:
        if _is_moved(made_for, timing, near):
            design, made_for, known = first, Timing(), of_first
        if _is_moved(made_for, timing, near):
            design, made_for, known = make(timing), timing, ()
        search = SubsetSearch(design.retimed(timing), excluded_words)
        best = search.run(known)[0]
        known = best.chosen  # with which the next round begins if it has the same columns
        every = [search.design.candidates[k] for k in best.chosen]
        left, penalised = search.design.total - best.gain, search.design.total - best.score
        penalty = len(words) * search.penalties.timing_penalty(every, best.shares, left)
        fitted = TimingFit(words, timing, penalised + penalty, left, len(words) + len(every), search, best)
        round_ += 1
        if is_last:
            return fitted
        if penalised > least:
            if before is not None:
                return before
            timing, is_last = Timing(), True  # worse than without any term and timing
        elif round_ == ROUNDS:
            return fitted
        else:
            if round_ == 1 and untimed is not None and _is_clearly_worse(penalised, untimed):
                again = fit_timing(first, untimed.best.chosen, untimed.timing, free, within_s)
            else:
                again = fit_timing(design, best.chosen, timing, free, within_s)
            if max(abs(again.delay_s - timing.delay_s), abs(again.lag_s - timing.lag_s)) < TOLERANCE_S:
                return fitted
            before, least = fitted.hypothesis, penalised
            timing = again
        if _is_moved(made_for, timing, near):
            design = first
            del search, fitted  # designs are large: this one goes before the next is made


def _is_clearly_worse(criterion: float, other: TimingFit[Any]) -> bool:
    noise: float = other.search.design.noise
    return criterion - noise > CLEARLY_WORSE * max(other.criterion - noise, 0.0)


def _start(design: D, free: tuple[bool, bool], within_s: tuple[float, float], is_free_clock: bool) -> Timing:
    """Return the initial timing of the search; `free`, `within_s`: as in `fit_timing`.

    Under a uniform load it is the delay of the edges, which was estimated with memories as regressors. A timing fitted
    to all rows without them would be biased by the loop of a slow load, by more than the search can correct. If delay
    and lag are both free, each is half of the delay of the edges. A free clock was aligned by the edges before.
    """
    observation = design.load.observation
    if not observation.is_uniform:
        return fit_timing(design, (), Timing(), free, within_s)
    late_s = 0.0 if is_free_clock else float(np.clip(observation.edge_delay_s, *within_s)) / max(sum(free), 1)
    return Timing(late_s if free[0] else 0.0, max(late_s, START_S) if free[1] else 0.0)


def _is_moved(one: Timing, other: Timing, near: Timing) -> bool:
    """Return whether two timings differ by more than `near`, so that columns must be computed anew."""
    return abs(other.delay_s - one.delay_s) > near.delay_s or abs(other.lag_s - one.lag_s) > near.lag_s
