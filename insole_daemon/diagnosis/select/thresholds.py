"""Refine the thresholds of strong snaps before the search.

Candidates have snaps at a grid of thresholds. The error of the grid leaves a residual of a strong snap, which the
search would otherwise take for further effects.
"""

from __future__ import annotations

from functools import cache

from ...physics.effect import Where
from ..model.blocks import BlockDesign
from ..model.design import Design
from ..model.refine import Refined, refine
from ..model.solve import is_possible, solve_shares
from ..terms.snap import TOGETHER
from .refined_settings import RefinedSettings

UPPER = "up_pa"
LEAST_SHARE = 0.05  # of the squared residual: gain of the strongest snap alone, for any to be refined
LEAST_SHARE_OF_WALK = 0.3  # the same of a walk, for each that is refined
COMPARABLE = 0.1  # of the gain of the strongest snap: gain at another place for that one to be refined
STARTS = 2  # best grid points of a place that are refined: the gain has several maxima in the thresholds
MOST_PLACES = 8


def refine_thresholds(design: BlockDesign) -> RefinedSettings:
    """Return the refined setting of a snap for each place where one explains much.

    If the load is not uniform, the taxels of a triangle may switch each by its own pressure or together by their mean.
    The strongest snap of a single triangle tells which. If each switches by its own, they do so at different times, the
    grid is fine enough, and nothing is refined.
    """
    gram, cross = design.gram.diagonal(), design.cross
    places: dict[Where, list[tuple[float, int]]] = {}
    for k, candidate in enumerate(design.candidates):
        if UPPER in candidate.term.refine:
            (column,) = candidate.columns.tolist()
            gain = max(float(cross[column]), 0.0) ** 2 / max(float(gram[column]), 1e-300)
            places.setdefault(candidate.where, []).append((gain, k))
    starts = sorted((sorted(each, reverse=True)[:STARTS] for each in places.values()), reverse=True)[:MOST_PLACES]
    strongest = starts[0][0][0] if starts else 0.0
    if strongest < LEAST_SHARE * design.total:
        return {}
    number_of = {k: k for of_place in starts for _, k in of_place}

    @cache
    def refined(k: int) -> Refined[BlockDesign]:
        return refine(design, (number_of[k],))

    if not design.seen.is_uniform:
        # Of a board, whose triangles have different thresholds, it would be the kind with the less exact one.
        clearest = next((of_place for of_place in starts if _is_of_triangle(design, of_place)), starts[0])
        own = refine(design, (clearest[0][1],))
        number_of = {k: len(design.candidates) + i for i, k in enumerate(number_of)}
        design = design.with_settings([(k, {**design.candidates[k].settings[0], TOGETHER: 1.0}) for k in number_of])
        if max(refined(k).gain for _, k in clearest) < own.gain:
            return {}
    settings = {}
    for of_place in starts:
        if of_place[0][0] > COMPARABLE * strongest:
            best = max((refined(k) for _, k in of_place), key=lambda one: one.gain)
            snap = best.design.candidates[0]
            settings[snap.word, snap.where] = snap.settings[0]
    return settings


def with_thresholds_of_walk(design: Design) -> Design:
    """Return `design` with refined thresholds of strong snaps of the insole and of boards; its arrays are overwritten.

    The grid of a walk is coarse. A triangle's part of the wrench hardly tells its thresholds.
    """
    best: dict[Where, tuple[float, int]] = {}
    for k, candidate in enumerate(design.candidates):
        if UPPER in candidate.term.refine and candidate.where.scope != "triangle":
            subset = design.subset([k])
            shares, gain = solve_shares(subset, subset.candidates)
            if is_possible([candidate], shares, load_is_known=False):
                best[candidate.where] = max(best.get(candidate.where, (0.0, k)), (gain, k))
    for gain, k in best.values():
        if gain > LEAST_SHARE_OF_WALK * design.total:
            design = design.exchange(k, refine(design, (k,)).design.candidates[0].settings[0])
    return design


def _is_of_triangle(design: BlockDesign, of_place: list[tuple[float, int]]) -> bool:
    """Return whether snaps, (gain, number), are of a single triangle."""
    return design.candidates[of_place[0][1]].where.scope == "triangle"
