"""Steps at the very moment at which they explain most: a grid of moments leaves much of a large one."""

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


def best_events(design: BlockDesign, beside: Sequence[int] = ()) -> Events:
    """Of every kind of event at every place, the setting at its best moment.

    `beside`: numbers of the candidates that are taken to be there, too.
    """
    best: dict[tuple[str, Where], tuple[float, int]] = {}
    for k, candidate in enumerate(design.candidates):
        if k in beside or not _is_event(candidate):
            continue
        part = design.subset([*beside, k])
        key, gain = (candidate.word, candidate.where), solve_shares(part, part.candidates)[1]
        if key not in best or gain > best[key][0]:
            best[key] = (gain, k)
    return {
        key: refine(design, (*beside, k)).design.candidates[-1].settings[0] for key, (_, k) in best.items()
    }  # fmt: skip


def with_events(design: BlockDesign, events: Events) -> BlockDesign:
    """`design` with a further candidate for each of `events`."""
    like = {(each.word, each.where): k for k, each in enumerate(design.candidates) if _is_event(each)}
    return design.with_settings([(like[key], setting) for key, setting in events.items()])


def _is_event(candidate: PlacedTerm) -> bool:
    return MOMENT in candidate.term.refine and candidate.settings[0][MOMENT] > 0.0
