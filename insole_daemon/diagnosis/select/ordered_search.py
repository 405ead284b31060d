"""Search in the order of the signal path: a term acts on the load as the terms before it have changed it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ..model.blocks import BlockDesign
from ..model.refine import refine
from ..model.regression import PlacedTerm, Timing
from ..model.signal_path import Changes, acts_on_load, load_changes
from .refined_settings import with_refined
from .search import GOOD_FIT, FittedSet, SubsetSearch, overlap
from .timing_search import TimingFit


def on_signal_path(
    first: TimingFit[BlockDesign], start: TimingFit[BlockDesign], make: Callable[[Timing, Changes], BlockDesign]
) -> TimingFit[BlockDesign] | None:
    """Return the best set of a search in which each term acts on the load as the terms before it have changed it.

    `start` has the terms that change the load at the beginning; `make` returns the design of a timing and of changes of
    the load, in the order of the signal path. Only terms that the new set contains, too, change the load. None if there
    are none, or if a single term of `first` explains the rows.
    """
    design, best = first.search.design, first.best
    if len(best.chosen) < 2 and design.total - best.gain < GOOD_FIT * design.noise:
        return None
    terms = zip(start.best.chosen, start.best.shares, strict=True)
    of_start = [(start.search.design.candidates[k], shares) for k, shares in terms]
    acting = [(term, shares) for term, shares in of_start if acts_on_load(term)]
    while acting:
        changes = load_changes(start.search.design, acting)
        start.search.design.forget_load()
        changed = _with_settings_of([term for term, _ in acting], make(first.timing, changes))
        among = SubsetSearch(changed.retimed(first.timing), first.search.excluded_words)
        ordered = among.run()[0]
        kept = [among.design.candidates[k] for k in ordered.chosen]
        remaining = [
            (term, shares) for term, shares in acting
            if any(other.word == term.word and overlap(other.where, term.where) for other in kept)
        ]  # fmt: skip
        if len(remaining) == len(acting):
            return with_refined_snaps(first.refitted(among, ordered))
        acting = remaining
        del among, changed, kept  # designs are large
    return None


def changes_load_of_a_part(fitted: TimingFit[BlockDesign]) -> bool:
    """Return whether a term of the set changes the load of a part of the insole for the terms after it."""
    chosen = [fitted.search.design.candidates[k] for k in fitted.best.chosen]
    return any(acts_on_load(term) and term.where.scope != "insole" for term in chosen)


def _with_settings_of(terms: Sequence[PlacedTerm], design: BlockDesign) -> BlockDesign:
    """Return `design` with further candidates: those like each of `terms` whose setting was refined."""
    return with_refined(design, {(term.word, term.where): term.settings[0] for term in terms})


def with_refined_snaps(first: TimingFit[BlockDesign]) -> TimingFit[BlockDesign]:
    """Return a fit with refined thresholds of its snaps, because a step of the load relaxes with a memory after it."""
    chosen = [first.search.design.candidates[k] for k in first.best.chosen]
    if not any(acts_on_load(term) and term.term.column is not None for term in chosen):
        return first
    return first.refitted(*with_refined_settings(first.search, first.best))


def with_refined_settings(
    search: SubsetSearch[BlockDesign], best: FittedSet
) -> tuple[SubsetSearch[BlockDesign], FittedSet]:
    """Return a search among further candidates, those of `best` with refined settings, and its best set."""
    refined = refine(search.design, best.chosen).design.candidates
    settings = [
        (k, candidate.settings[0])
        for k, candidate in zip(best.chosen, refined, strict=True)
        if candidate.settings is not search.design.candidates[k].settings
    ]
    if not settings:
        return search, best
    numbers = {k: len(search.design.candidates) + i for i, (k, _) in enumerate(settings)}
    among = SubsetSearch(search.design.with_settings(settings), search.excluded_words, search.is_last)
    # Exchanging one term at a time might not reach the set whose parameters were refined together.
    together = among.fit([numbers.get(k, k) for k in best.chosen])
    return among, among.run(max(together, best, key=lambda fitted: fitted.score).chosen)[0]
