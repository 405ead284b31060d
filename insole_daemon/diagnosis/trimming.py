"""A set of terms less those that rows do not bear out to which they were not fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..physics.law import Array
from .model.blocks import BlockDesign
from .model.design import Design
from .model.refine import Refined, refine
from .model.regression import Timing
from .model.solve import solve_shares
from .searching import WELL
from .select.count_figures import count_figures, square_by_triangle
from .select.search import FittedSet, SubsetSearch
from .select.wrench_figures import Figures, figures

LEAST_GAINED = 0.001  # of what a set explains, that each of it does where it enters
LEAST_NEEDED = 0.05  # of it, that is lost where one that does not is left out: less, and it is not needed
MOST_WORSE = np.array([1.02, 1.1, 1.1])  # times the error before, of f_z, m_x and m_y on held-out rows


@dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """A set of terms that rows bear out which were held out, its refinement and its figures."""

    best: FittedSet
    refined: Refined[Any]
    order: tuple[int, ...]  # of its candidates, the largest first
    figures: Figures


def trimmed(search: SubsetSearch[Any], best: FittedSet, timing: Timing) -> Kept:
    """`best` less what explains nothing once all is refined, or on rows it was not fitted to."""
    while True:
        refined = refine(search.design, best.chosen)
        idle = _idle(search, best.chosen, refined)
        if idle is not None:
            best = search.fit([k for i, k in enumerate(best.chosen) if i != idle])
            continue
        doubtful = doubtful_word(search.design, refined)
        if doubtful is not None:
            words = [search.design.candidates[k].word for k in best.chosen]
            best = search.fit([k for k, word in zip(best.chosen, words, strict=True) if word != doubtful])
            continue
        kept = _kept(best, refined, timing)
        if kept.order and not _is_better(kept.figures):
            # What makes rows worse that it was not fitted to explains nothing.
            best = search.fit([k for i, k in enumerate(best.chosen) if i != kept.order[-1]])
            continue
        lighter = _lighter(search, kept, timing)
        if lighter is None:
            return kept
        best = lighter


def stronger(search: SubsetSearch[Any], kept: Kept, measured: Refined[Any], least: float, timing: Timing) -> Kept:
    """What of a set explains more than `least` variances of the noise by itself.

    `measured`: the set with the columns that count, all of them or those of its families.
    """
    best = kept.best
    strong = [k for i, k in enumerate(best.chosen) if measured.gain - measured.gain_without(i) > least]
    if len(strong) == len(best.chosen):
        return kept
    fitted = search.fit(strong)
    return _kept(fitted, refine(search.design, fitted.chosen), timing)


def _kept(best: FittedSet, refined: Refined[Any], timing: Timing) -> Kept:
    order = sorted(range(len(refined.shares)), key=lambda i: -_energy(refined, i))
    return Kept(best, refined, tuple(order), figures_of(refined, order, timing))


def figures_of(
    refined: Refined[Any],
    order: Sequence[int],
    timing: Timing,
    nuisances: Sequence[int] = (),
    uncertain_s: float = 0.0,
) -> Figures:
    """Of a refined set: counts where the load of every taxel is known, else of the wrench."""
    if isinstance(refined.design, BlockDesign):
        return count_figures(refined, order)
    return figures(refined.design, refined, order, timing, nuisances, uncertain_s)


def _is_better(found: Figures) -> bool:
    """Whether rows that were held out have become better on the whole, and no channel clearly worse."""
    level = np.maximum(found.floor, 1e-12)
    whole = np.sum((found.after / level) ** 2) < np.sum((found.before / level) ** 2)
    return bool(whole and np.all(found.after <= MOST_WORSE[: len(found.after)] * found.before))


def _lighter(search: SubsetSearch[Any], kept: Kept, timing: Timing) -> FittedSet | None:
    """The set without a candidate that makes the error hardly smaller on rows that were held out; None: all do.

    Neither when it enters after stronger ones, nor when all others are there. A clock only aligns.
    """
    whole, best, found = search.design, kept.best, kept.figures
    least_needed = LEAST_NEEDED if isinstance(whole, BlockDesign) else LEAST_GAINED
    unit = np.maximum(found.floor, 1e-12)  # of each channel

    def square(rms: Array) -> float:
        return float(np.sum((rms / unit) ** 2))

    before, after = square(found.before), square(found.after)
    for i, gain in reversed(list(zip(kept.order, found.gains, strict=True))):
        if gain > LEAST_GAINED * sum(found.gains) or whole.candidates[best.chosen[i]].word == "clock":
            continue
        rest = [k for j, k in enumerate(best.chosen) if j != i]
        others = search.singles() if len(rest) == 1 else []
        without = max([search.fit(rest), *others], key=lambda each: each.score)
        left = square(_kept(without, refine(whole, without.chosen), timing).figures.after)
        needed = least_needed * (before - after) * _share_of_insole(whole, best.chosen[i])
        if best.chosen[i] not in without.chosen and left - after < needed:
            return without
    return None


def _share_of_insole(whole: Design | BlockDesign, k: int) -> float:
    """Return the share of the triangles that candidate `k` is at; 1 where only the whole load is known."""
    if not isinstance(whole, BlockDesign):
        return 1.0
    return float(np.mean(whole.mask[whole.candidates[k].columns[0]][whole.weights.any(axis=0)]))


def doubtful_word(whole: Design | BlockDesign, refined: Refined[Any]) -> str | None:
    """Return the word that explains least of those that explain less than the set leaves beyond the noise where it is.

    Such a word may describe a part of the lack of fit, as in an F-test, whose scale is what the model leaves. A
    recalibration counts with its whole size, because nuisances take up most of it. A clock only aligns.
    """
    noise = float(np.count_nonzero(whole.weights))
    lack_of_fit = whole.total - refined.gain - noise
    if lack_of_fit < (WELL - 1.0) * noise:
        return None
    candidates = refined.design.candidates
    lack_by_triangle = None
    if isinstance(refined.design, BlockDesign):
        lack_by_triangle = square_by_triangle(refined) - np.count_nonzero(refined.design.weights, axis=0)
    doubtful: dict[str, float] = {}
    for word in {candidate.word for candidate in candidates} - {"clock"}:
        of_word = [i for i, candidate in enumerate(candidates) if candidate.word == word]
        others = [candidate for candidate in candidates if candidate.word != word]
        explained, lack = refined.gain - solve_shares(refined.design, others)[1], lack_of_fit
        if lack_by_triangle is not None:
            explained += sum(
                refined.design.size(candidates[i], refined.shares[i])
                for i in of_word
                if refined.design.is_within_priors(candidates[i])
            )
            at = np.any([refined.design.mask[candidates[i].columns[0]] for i in of_word], axis=0)
            lack = min(lack, float(np.sum(lack_by_triangle[at])))
        if explained < lack:
            doubtful[word] = explained
    return min(doubtful, key=doubtful.__getitem__, default=None)


def _idle(search: SubsetSearch[Any], chosen: Sequence[int], refined: Refined[Any]) -> int | None:
    """A candidate that explains less than its price now that the others are refined; None where all are worth it.

    Of several, that without which the others explain most once they are refined again.
    """
    every = [search.design.candidates[k] for k in chosen]
    prices = [search.prices.least_price(k, each, every) for k, each in zip(chosen, every, strict=True)]
    idle = [i for i, price in enumerate(prices) if refined.gain - refined.gain_without(i) < price]
    if len(idle) < 2:
        return idle[0] if idle else None

    def score_without(i: int) -> float:
        others = tuple(j for j in range(len(every)) if j != i)
        return refine(refined.design, others).gain - sum(prices[j] for j in others)

    return max(idle, key=score_without)


def _energy(refined: Refined[Any], i: int) -> float:
    columns = refined.design.candidates[i].columns
    share = refined.shares[i]
    return float(share @ refined.design.gram[np.ix_(columns, columns)] @ share)
