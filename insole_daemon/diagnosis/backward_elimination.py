"""Backward elimination: remove the terms of a selected set that do not lower the held-out error."""

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
from .select import confidence
from .select.count_errors import residual_squares
from .select.each_triangle import of_each_triangle
from .select.heldout_errors import heldout_errors
from .select.search import GOOD_FIT, FittedSet, SubsetSearch
from .select.wrench_errors import HeldoutErrors

LEAST_GAINED = 0.001  # gain of a term when it is added, relative to the sum of the gains of the set
LEAST_NEEDED = 0.05  # loss of held-out gain without a term that gains less, relative to the set's, for it to stay
LEAST_ELSEWHERE = 3  # triangles without a term, to compare its gain with theirs
MISFIT = 4.0  # mean square of a walk's held-out error over that of its floor, above which every term is tried
CLEARLY_LESS = 0.8  # of the held-out mean square error: a term is removed if less than that is left without it
UPPER = 0.9  # quantile of the gains elsewhere
LEAST_RATIO = 20.0  # of the median gain where a term is to that quantile
MOST_WORSE = np.array([1.02, 1.1, 1.1])  # held-out error of f_z, m_x and m_y, relative to that of the model handed in


@dataclass(frozen=True, slots=True, eq=False)
class ValidatedSet:
    """A set of terms that lower the held-out error, with its refinement and its errors."""

    best: FittedSet
    refined: Refined[Any]
    order: tuple[int, ...]  # of its candidates, the largest sum of squares first
    figures: HeldoutErrors


def eliminate_backward(search: SubsetSearch[Any], best: FittedSet, timing: Timing) -> ValidatedSet:
    """Return `best` without terms that are not worth their penalty after refinement, or on held-out rows.

    One term is removed at a time, in this order of rules: its gain is below its penalty; a term of single triangles
    gains nearly as much in others; its word explains less than the lack of fit; the set makes held-out rows worse; its
    held-out gain is negligible, or the held-out error is clearly smaller without it.
    """
    while True:
        refined = refine(search.design, best.chosen)
        removed = _idle(search, best.chosen, refined)
        if removed is None:
            removed = term_with_gains_elsewhere(refined)
        if removed is not None:
            best = search.fit([k for i, k in enumerate(best.chosen) if i != removed])
            continue
        doubtful = insignificant_word(search.design, refined)
        if doubtful is not None:
            words = [search.design.candidates[k].word for k in best.chosen]
            best = search.fit([k for k, word in zip(best.chosen, words, strict=True) if word != doubtful])
            continue
        kept = _validated(best, refined, timing)
        if kept.order and not _is_better(kept.figures):
            best = search.fit([k for i, k in enumerate(best.chosen) if i != kept.order[-1]])
            continue
        reduced = _without_useless(search, kept, timing)
        if reduced is None:
            return kept
        best = reduced


def keep_strong(
    search: SubsetSearch[Any], kept: ValidatedSet, measured: Refined[Any], least: float, timing: Timing
) -> ValidatedSet:
    """Return the terms of a set whose gain is above `least`, in variances of the noise.

    `measured`: the same set with the columns whose gain counts, with or without internal companions.
    """
    best = kept.best
    strong = [k for i, k in enumerate(best.chosen) if measured.gain - measured.gain_without(i) > least]
    if len(strong) == len(best.chosen):
        return kept
    fitted = search.fit(strong)
    return _validated(fitted, refine(search.design, fitted.chosen), timing)


def is_believed(search: SubsetSearch[Any], kept: ValidatedSet) -> bool:
    """Return whether enough of the terms are probably there, by their confidences."""
    stated = [
        confidence.confidence(
            search.margin(kept.best, i), kept.figures.residual_fraction, len(kept.order),
            confidence.is_of_triangles(candidate.word, candidate.where),
        )
        for i, candidate in enumerate(kept.refined.design.candidates)
    ]  # fmt: skip
    return not stated or float(np.mean(stated)) > confidence.LEAST_MEAN


def _validated(best: FittedSet, refined: Refined[Any], timing: Timing) -> ValidatedSet:
    """Return a refined set with its held-out errors."""
    order = sorted(range(len(refined.shares)), key=lambda i: -_energy(refined, i))
    return ValidatedSet(best, refined, tuple(order), heldout_errors(refined, order, timing))


def _is_better(errors: HeldoutErrors) -> bool:
    """Return whether the held-out error is smaller over all channels, and clearly larger in none."""
    level = np.maximum(errors.floor, 1e-12)
    is_smaller = np.sum((errors.after / level) ** 2) < np.sum((errors.before / level) ** 2)
    return bool(is_smaller and np.all(errors.after <= MOST_WORSE[: len(errors.after)] * errors.before))


def _without_useless(search: SubsetSearch[Any], kept: ValidatedSet, timing: Timing) -> FittedSet | None:
    """Return the set without a candidate that is of no use on held-out rows; None if there is none.

    Its gain is negligible if it is small both when the candidate is added after stronger ones and when it is removed
    from the complete set. On a walk that the set describes badly, each candidate is tried, because a wrong one may have
    been chosen before the right ones, and may gain much beside them: it is of no use if the error is clearly smaller
    without it.
    """
    whole, best, errors = search.design, kept.best, kept.figures
    is_chamber = isinstance(whole, BlockDesign)
    least_needed = LEAST_NEEDED if is_chamber else LEAST_GAINED
    unit = np.maximum(errors.floor, 1e-12)  # of each channel

    def square(rms: Array) -> float:
        return float(np.sum((rms / unit) ** 2))

    before, after = square(errors.before), square(errors.after)
    is_misfit = not is_chamber and after > MISFIT * len(unit)
    for i, gain in reversed(list(zip(kept.order, errors.gains, strict=True))):
        k = best.chosen[i]
        is_small = gain <= LEAST_GAINED * sum(errors.gains) and not _is_without_heldout_effect(whole, k, errors)
        if not (is_small or is_misfit):
            continue
        rest = [other for other in best.chosen if other != k]
        others = search.singles() if len(rest) == 1 else []
        without = max([search.fit(rest), *others], key=lambda fitted: fitted.score)
        if k in without.chosen:
            continue
        after_without = square(_validated(without, refine(whole, without.chosen), timing).figures.after)
        needed = least_needed * (before - after) * _share_of_insole(whole, k)
        if (is_small and after_without - after < needed) or (is_misfit and after_without < CLEARLY_LESS * after):
            return without
    return None


def _is_without_heldout_effect(whole: Design | BlockDesign, k: int, errors: HeldoutErrors) -> bool:
    """Return whether candidate `k` hardly changes the held-out error although it is real.

    A clock only aligns. Curves that were refitted beside a memory absorb a static effect. Only one of a part of the
    insole counts, because the mean curve of a memory, the reason to refit them, is alike on all boards.
    """
    candidate = whole.candidates[k]
    if candidate.word == "clock":
        return True
    is_refitted = isinstance(whole, BlockDesign) and errors.recalibrated is not None
    return is_refitted and whole.is_within_priors(candidate) and candidate.where.scope != "insole"


def _share_of_insole(whole: Design | BlockDesign, k: int) -> float:
    """Return the share of the triangles that candidate `k` is at; 1 where only the whole load is known."""
    if not isinstance(whole, BlockDesign):
        return 1.0
    return float(np.mean(whole.mask[whole.candidates[k].columns[0]][whole.weights.any(axis=0)]))


def term_with_gains_elsewhere(refined: Refined[Any]) -> int | None:
    """Return the position of a term of single triangles that gains nearly as much in others; None if there is none.

    Such a term is fitted to each triangle alone, on the residual of the others. Where an effect really is, its gain is
    far above that in the triangles elsewhere. What a law of the other terms does not describe gives a gain in many
    triangles. Snaps are left out, because the column of a snap is a part of any loop. Of several terms, the one with
    the smallest gain relative to that elsewhere.
    """
    design = refined.design
    local = [
        i
        for i, term in enumerate(design.candidates)
        if confidence.is_of_triangles(term.word, term.where) and term.word != "snap"
    ]
    if not local or not isinstance(design, BlockDesign):
        return None
    works = design.weights.any(axis=0)
    ratios = {}
    for i in local:
        design = refined.design.everywhere(i, refined.shares)
        term = design.candidates[i]
        own = works & design.mask[term.columns[0]]
        same_word = [design.mask[other.columns[0]] for other in design.candidates if other.word == term.word]
        elsewhere = works & ~np.any(same_word, axis=0)
        if np.count_nonzero(elsewhere) < LEAST_ELSEWHERE or not own.any():
            continue
        cross = design.residual_cross(design.candidates, refined.shares)
        effect = design.atoms.gram[:, :, design.atom[term.columns]] @ refined.shares[i]
        r, _, shares = of_each_triangle(design, term, cross + own[:, None] * effect)
        gains = np.einsum("tk,tk->t", r, shares)
        ratios[i] = float(np.median(gains[own])) / max(float(np.quantile(gains[elsewhere], UPPER)), 1.0)
    least = min(ratios, key=ratios.__getitem__, default=None)
    return least if least is not None and ratios[least] < LEAST_RATIO else None


def insignificant_word(whole: Design | BlockDesign, refined: Refined[Any]) -> str | None:
    """Return the word that explains least of those that explain less than the set leaves beyond the noise where it is.

    Such a word may describe a part of the lack of fit, as in an F-test, whose scale is what the model leaves. A
    recalibration counts with its whole size, because nuisances take up most of it. A clock only aligns.
    """
    noise = whole.noise
    lack_of_fit = whole.total - refined.gain - noise
    if lack_of_fit < (GOOD_FIT - 1.0) * noise:
        return None
    candidates = refined.design.candidates
    lack_by_triangle = None
    if isinstance(refined.design, BlockDesign):
        lack_by_triangle = residual_squares(refined) - np.count_nonzero(refined.design.weights, axis=0)
    doubtful: dict[str, float] = {}
    for word in {candidate.word for candidate in candidates} - {"clock"}:
        of_word = [i for i, candidate in enumerate(candidates) if candidate.word == word]
        others = [candidate for candidate in candidates if candidate.word != word]
        explained, lack = refined.gain - solve_shares(refined.design, others)[1], lack_of_fit
        explained += sum(
            refined.design.size(candidates[i], refined.shares[i])
            for i in of_word
            if refined.design.is_within_priors(candidates[i])
        )
        if lack_by_triangle is not None:
            at = np.any([refined.design.mask[candidates[i].columns[0]] for i in of_word], axis=0)
            lack = min(lack, float(np.sum(lack_by_triangle[at])))
        if explained < lack:
            doubtful[word] = explained
    return min(doubtful, key=doubtful.__getitem__, default=None)


def _idle(search: SubsetSearch[Any], chosen: Sequence[int], refined: Refined[Any]) -> int | None:
    """Return the position of a candidate whose gain is below its penalty after refinement; None if there is none.

    Of several, the one without which the others have the highest score after they are refined again.
    """
    terms = [search.design.candidates[k] for k in chosen]
    penalties = [search.penalties.term_penalty(k, term, terms) for k, term in zip(chosen, terms, strict=True)]
    idle = [i for i, penalty in enumerate(penalties) if refined.gain - refined.gain_without(i) < penalty]
    if len(idle) < 2:
        return idle[0] if idle else None

    def score_without(i: int) -> float:
        others = tuple(j for j in range(len(terms)) if j != i)
        return refine(refined.design, others).gain - sum(penalties[j] for j in others)

    return max(idle, key=score_without)


def _energy(refined: Refined[Any], i: int) -> float:
    """Return the sum of squares of the effect of candidate `i`, in variances of the noise."""
    columns = refined.design.candidates[i].columns
    share = refined.shares[i]
    return float(share @ refined.design.gram[np.ix_(columns, columns)] @ share)
