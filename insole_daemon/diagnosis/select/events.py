"""Refine the times of events (steps of the baseline or of the reference) before the search.

Candidates have events on a grid of times (`terms.term.moments_s`). The error of the grid leaves a large residual of a
large step, which the search would otherwise take for further effects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ...physics.effect import Where
from ..model.blocks import BlockDesign
from ..model.refine import refine
from ..model.regression import PlacedTerm
from ..model.solve import solve_shares
from ..terms.term import Setting

MOMENT = "t_s"
Events = Mapping[tuple[str, Where], Setting]


def refine_events(design: BlockDesign, selected: Sequence[int] = ()) -> Events:
    """Return, for every event word and place, the setting with the time of the largest gain, refined.

    `selected`: numbers of candidates that are fitted together with each event.
    """
    best: dict[tuple[str, Where], tuple[float, int]] = {}
    for k, candidate in enumerate(design.candidates):
        if k in selected or not _is_event(candidate):
            continue
        subset = design.subset([*selected, k])
        key, gain = (candidate.word, candidate.where), solve_shares(subset, subset.candidates)[1]
        if key not in best or gain > best[key][0]:
            best[key] = (gain, k)
    return {
        key: refine(design, (*selected, k)).design.candidates[-1].settings[0] for key, (_, k) in best.items()
    }  # fmt: skip


def with_events(design: BlockDesign, events: Events) -> BlockDesign:
    """Return `design` with a further candidate for each of `events`."""
    on_grid = {(event.word, event.where): k for k, event in enumerate(design.candidates) if _is_event(event)}
    return design.with_settings([(on_grid[key], setting) for key, setting in events.items()])


def _is_event(candidate: PlacedTerm) -> bool:
    return MOMENT in candidate.term.refine and candidate.settings[0][MOMENT] > 0.0
