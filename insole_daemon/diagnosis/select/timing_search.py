"""The best set of terms for every combination of a delay and a lag of the whole insole, and the best of these."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic

import numpy as np

from ..model.regression import D, Timing
from ..model.timing import MOST_S, START_S, TOLERANCE_S, fit_timing
from .search import FittedSet, SubsetSearch

ROUNDS = 4
NEAR = Timing(0.008, 0.03)  # changes of the timing that terms need not follow
NEARER = Timing(0.001, 0.004)  # the same of the hypothesis that is the best


@dataclass(frozen=True, slots=True, eq=False)
class Timed:
    """A hypothesis on the timing."""

    words: tuple[str, ...]  # "delay", "lag", or "clock" where readings come early
    timing: Timing
    left: float  # squared residual and prices of its best set


@dataclass(frozen=True, slots=True, eq=False)
class TimedSet(Timed, Generic[D]):
    """The same with its best set."""

    search: SubsetSearch[D]
    best: FittedSet


def search_timings(
    make: Callable[[Timing], D], is_free_clock: bool, known: Sequence[Timed] = ()
) -> tuple[TimedSet[D], tuple[Timed, ...]]:
    """The best hypothesis on the timing with its best set, and the others, best first.

    `make` gives the design of rows under the load of a timing: terms that act on it are late with it. On a clock whose
    offset is free a delay is no hypothesis: its time is fitted in all of them. Where readings seem to come early,
    because a declared clock is wrong, terms are computed at the times that they have then. `known`: the hypotheses of a
    search of the same rows under other priors, from whose times this one begins.
    """
    hypotheses: list[tuple[str, ...]] = [("lag",)] if is_free_clock else [("delay",), ("lag",)]
    first = make(Timing())
    before = {each.words: each.timing for each in known}
    best = _best_of(first, make, (), is_free_clock, before.get(()))
    others: list[Timed] = []

    def add(words: tuple[str, ...], start: Timing | None = None) -> None:
        nonlocal best
        one = _best_of(first, make, words, is_free_clock, before.get(words, start))
        best, other = (one, best) if one.left < best.left else (best, one)
        others.append(Timed(other.words, other.timing, other.left))  # designs are large

    for words in hypotheses:
        add(words)
    if not is_free_clock:
        if best.words:
            add(("delay", "lag"))  # both are worth it where one of them is
        # A loop beside a wrong clock can hold the edges where they are.
        early = fit_timing(first, (), Timing(), *_freedom(("clock",), is_free_clock))
        if early.delay_s < -NEAR.delay_s:
            add(("clock",), early)
    if best.words:
        start, words = best.timing, best.words
        del best  # designs are large: this one goes before the next is made
        best = _from(start, first, make, words, *_freedom(words, is_free_clock), NEARER)
    return best, tuple(sorted(others, key=lambda each: each.left))


def _best_of(
    first: D, make: Callable[[Timing], D], words: tuple[str, ...], is_free_clock: bool, start: Timing | None
) -> TimedSet[D]:
    """The best timing and set of a hypothesis, from `start` or from what the rows suggest."""
    free, within_s = _freedom(words, is_free_clock)
    if start is None:
        start = _start(first, free, within_s, is_free_clock)
    return _from(start, first, make, words, free, within_s)


def _freedom(words: tuple[str, ...], is_free_clock: bool) -> tuple[tuple[bool, bool], tuple[float, float]]:
    """Whether delay and lag are searched for, and between which delays."""
    free = ("delay" in words or "clock" in words or is_free_clock, "lag" in words)
    return free, (0.0 if "delay" in words else -MOST_S, 0.0 if "clock" in words else MOST_S)


def _from(
    timing: Timing,
    first: D,
    make: Callable[[Timing], D],
    words: tuple[str, ...],
    free: tuple[bool, bool],
    within_s: tuple[float, float],
    near: Timing = NEAR,
) -> TimedSet[D]:
    """The best timing and set that are reached from `timing`, the terms and the times fitted in turn.

    Terms follow the timing where it changes by more than `near`. A timing that leaves more than the one before is not
    used: columns are straight lines, which far from where they were made can promise what the rows do not bear out.
    """
    # Readings that come early could undo a delay again.
    barred = frozenset({"clock"}) if "delay" in words or "clock" in words else frozenset()
    design, made_for = first, Timing()
    before, least, is_back = Timing(), first.total, False
    for round_ in range(ROUNDS + 1):
        if _is_moved(made_for, timing, near):
            design, made_for = make(timing), timing
        search = SubsetSearch(design.retimed(timing), barred)
        best = search.run()[0]
        left = search.design.total - best.score
        if not any(free) or is_back:
            break
        if left > least:
            timing, is_back = before, True
        elif round_ >= ROUNDS - 1:
            break
        else:
            again = fit_timing(design, best.chosen, timing, free, within_s)
            if max(abs(again.delay_s - timing.delay_s), abs(again.lag_s - timing.lag_s)) < TOLERANCE_S:
                break
            before, least, timing = timing, left, again
        if _is_moved(made_for, timing, near):
            design = first
            del search  # designs are large: this one goes before the next is made
    if "lag" in words and timing.lag_s < design.load.observation.least_lag_s:
        return TimedSet(words, timing, np.inf, search, best)
    every = [search.design.candidates[k] for k in best.chosen]
    price = len(words) * search.prices.of_timing(every, best.shares)
    return TimedSet(words, timing, left + price, search, best)


def _start(design: D, free: tuple[bool, bool], within_s: tuple[float, float], is_free_clock: bool) -> Timing:
    """The timing without any terms, from which the search begins; `free`, `within_s`: as in `fit_timing`.

    Under a uniform load edges tell by how much readings are late, with memories beside them: without any, the loop of a
    slow load would move it by more than the search can find back. A delay and a lag share it. A free clock is aligned
    by them already.
    """
    observation = design.load.observation
    if not observation.is_uniform:
        return fit_timing(design, (), Timing(), free, within_s)
    late_s = 0.0 if is_free_clock else float(np.clip(observation.edge_delay_s, *within_s)) / max(sum(free), 1)
    return Timing(late_s if free[0] else 0.0, max(late_s, START_S) if free[1] else 0.0)


def _is_moved(one: Timing, other: Timing, near: Timing) -> bool:
    """Whether terms of a design that was made for `one` need to follow `other`."""
    return abs(other.delay_s - one.delay_s) > near.delay_s or abs(other.lag_s - one.lag_s) > near.lag_s
