"""Refine the times of events (steps of the baseline or of the reference) before the search.

Candidates have events on a grid of times (`terms.term.moments_s`). The error of the grid leaves a large residual of a
large step, which the search would otherwise take for further effects.
"""

from __future__ import annotations

from collections.abc import Sequence

from ...physics.effect import Where
from ..model.blocks import BlockDesign
from ..model.refine import refine
from ..model.regression import PlacedTerm
from ..model.solve import solve_shares
from .refined_settings import RefinedSettings
from .search import SubsetSearch

MOMENT = "t_s"
LEAST_GAIN = 500.0  # of an event, in variances of the noise: the error of the grid leaves few percent of it
LEAST_SHARE = 0.02  # least gain of an event, relative to the squared residual of the terms that are fitted beside it


def refine_events(design: BlockDesign) -> RefinedSettings:
    """Return refined events beside the law that explains most alone, as `refine_events_beside`.

    A drift is none: it may have any course over time, and that of a step, too.
    """
    search = SubsetSearch(design)
    alone = [single for single in search.singles() if design.candidates[single.chosen[0]].word != "drift"]
    strongest = max([search.fit(()), *alone], key=lambda fitted: fitted.score).chosen
    return refine_events_beside(design, [k for k in strongest if not _is_event(design.candidates[k])])


def refine_events_beside(design: BlockDesign, selected: Sequence[int]) -> RefinedSettings:
    """Return the setting with the time of the largest gain, refined, for every event word and place that explains much.

    `selected`: numbers of candidates that are fitted together with each event, with the parameters that they have.
    """
    known = design.subset(selected)
    gain_before = solve_shares(known, known.candidates)[1]
    least = gain_before + max(LEAST_GAIN, LEAST_SHARE * (design.total - gain_before))
    best: dict[tuple[str, Where], tuple[float, int]] = {}
    for k, candidate in enumerate(design.candidates):
        if k in selected or not _is_event(candidate):
            continue
        subset = design.subset([*selected, k])
        key, gain = (candidate.word, candidate.where), solve_shares(subset, subset.candidates)[1]
        if gain > best.get(key, (least, k))[0]:
            best[key] = (gain, k)
    return {
        key: refine(design, (*selected, k), len(selected)).design.candidates[-1].settings[0]
        for key, (_, k) in best.items()
    }


def _is_event(candidate: PlacedTerm) -> bool:
    return MOMENT in candidate.term.refine and candidate.settings[0][MOMENT] > 0.0
