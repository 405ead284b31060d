"""The best set of terms for every combination of a delay and a lag of the whole insole, and the best of these."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic

import numpy as np

from ..model.regression import D, Timing
from ..model.timing import MOST_S, START_S, TOLERANCE_S, fit_timing
from .search import FittedSet, SubsetSearch

ROUNDS = 4
UNMOVED_S, UNLAGGED_S = 0.008, 0.03  # of a delay and of a lag, that terms need not follow


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


def search_timings(make: Callable[[Timing], D], is_free_clock: bool) -> tuple[TimedSet[D], tuple[Timed, ...]]:
    """The best hypothesis on the timing with its best set, and the others, best first.

    `make` gives the design of rows under the load of a timing: terms that act on it are late with it. On a clock whose
    offset is free a delay is no hypothesis: its time is fitted in all of them. Where readings seem to come early,
    because a declared clock is wrong, terms are computed at the times that they have then.
    """
    hypotheses: list[tuple[str, ...]] = [("lag",)] if is_free_clock else [("delay",), ("lag",)]
    first = make(Timing())
    best = _one(first, make, (), is_free_clock)
    others: list[Timed] = []

    def add(words: tuple[str, ...]) -> None:
        nonlocal best
        one = _one(first, make, words, is_free_clock)
        best, other = (one, best) if one.left < best.left else (best, one)
        others.append(Timed(other.words, other.timing, other.left))  # designs are large

    for words in hypotheses:
        add(words)
    if not is_free_clock:
        if best.words:
            add(("delay", "lag"))  # both are worth it where one of them is
        early = fit_timing(first, (), Timing(), (True, False), (-MOST_S, 0.0))
        if early.delay_s < -UNMOVED_S:
            add(("clock",))
    return best, tuple(sorted(others, key=lambda each: each.left))


def _one(first: D, make: Callable[[Timing], D], words: tuple[str, ...], is_free_clock: bool) -> TimedSet[D]:
    free = ("delay" in words or "clock" in words or is_free_clock, "lag" in words)
    within_s = (0.0 if "delay" in words else -MOST_S, 0.0 if "clock" in words else MOST_S)
    # Readings that come early could undo a delay again.
    barred = frozenset({"clock"}) if "delay" in words or "clock" in words else frozenset()
    design, made_for = first, Timing()
    if is_free_clock and design.load.observation.is_uniform:
        # Edges have aligned it with memories beside them; without any, the loop of a slow load would move it.
        timing = Timing(0.0, START_S if "lag" in words else 0.0)
    else:
        timing = fit_timing(design, (), Timing(), free, within_s)
    for round_ in range(ROUNDS):
        if _is_moved(made_for, timing):
            design, made_for = make(timing), timing
        search = SubsetSearch(design.retimed(timing), barred)
        best = search.run()[0]
        if not any(free) or round_ == ROUNDS - 1:
            break
        again = fit_timing(design, best.chosen, timing, free, within_s)
        if max(abs(again.delay_s - timing.delay_s), abs(again.lag_s - timing.lag_s)) < TOLERANCE_S:
            break
        timing = again
        if _is_moved(made_for, timing):
            design = first
            del search  # designs are large: this one goes before the next is made
    if "lag" in words and timing.lag_s < design.load.observation.least_lag_s:
        return TimedSet(words, timing, np.inf, search, best)
    every = [search.design.candidates[k] for k in best.chosen]
    price = len(words) * search.prices.of_timing(every, best.shares)
    return TimedSet(words, timing, search.design.total - best.score + price, search, best)


def _is_moved(one: Timing, other: Timing) -> bool:
    """Whether terms of a design that was made for `one` need to follow `other`."""
    return abs(other.delay_s - one.delay_s) > UNMOVED_S or abs(other.lag_s - one.lag_s) > UNLAGGED_S
