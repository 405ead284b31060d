"""The best set of terms for every combination of a delay and a lag of the whole insole, and the best of these."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic

import numpy as np

from ..model.regression import D, Timing
from ..model.timing import LEAST_LAG_S, fit_timing
from .search import FittedSet, SubsetSearch

ROUNDS = 4


@dataclass(frozen=True, slots=True, eq=False)
class TimedSet(Generic[D]):
    """A set with its timing."""

    words: tuple[str, ...]  # of the timing: "delay", "lag"
    timing: Timing
    search: SubsetSearch[D]
    best: FittedSet
    left: float  # squared residual and prices


def search_timings(design: D, is_free_clock: bool) -> list[TimedSet[D]]:
    """Every hypothesis on the timing with its best set, best first.

    On a clock whose offset is free a delay is no hypothesis: its time is fitted in all of them.
    """
    hypotheses: list[tuple[str, ...]] = (
        [(), ("lag",)] if is_free_clock else [(), ("delay",), ("lag",), ("delay", "lag")]
    )
    found = [_one(design, words, is_free_clock) for words in hypotheses]
    return sorted(found, key=lambda each: each.left)


def _one(design: D, words: tuple[str, ...], is_free_clock: bool) -> TimedSet[D]:
    free = ("delay" in words or is_free_clock, "lag" in words)
    # Readings that come early could undo a delay again.
    barred = frozenset({"clock"}) if "delay" in words else frozenset()
    timing = fit_timing(design, (), Timing(), free, is_free_clock)
    search = SubsetSearch(design.retimed(timing), barred)
    best = search.run()[0]
    for _ in range(ROUNDS - 1):
        moved = fit_timing(design, best.chosen, timing, free, is_free_clock)
        if moved == timing:
            break
        timing = moved
        search = SubsetSearch(design.retimed(timing), barred)
        best = search.run()[0]
    if "lag" in words and timing.lag_s < LEAST_LAG_S:  # it would only average the reference's noise
        return TimedSet(words, timing, search, best, np.inf)
    every = [search.design.candidates[k] for k in best.chosen]
    price = len(words) * search.prices.of_timing(every, best.shares)
    return TimedSet(words, timing, search, best, search.design.total - best.score + price)
