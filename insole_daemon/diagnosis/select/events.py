"""Steps at the very moment at which they explain most: a grid of moments leaves much of a large one."""

from __future__ import annotations

from collections.abc import Sequence

from ..model.blocks import BlockDesign
from ..model.refine import refine
from ..model.solve import solve_shares

MOMENT = "t_s"


def with_events(design: BlockDesign, beside: Sequence[int] = ()) -> BlockDesign:
    """`design` with a further candidate for every kind of event at every place, at its best moment.

    `beside`: numbers of the candidates that are taken to be there, too.
    """
    best: dict[tuple[str, object], tuple[float, int]] = {}
    for k, candidate in enumerate(design.candidates):
        if MOMENT not in candidate.term.refine or k in beside or not candidate.settings[0][MOMENT] > 0.0:
            continue
        part = design.subset([*beside, k])
        key, gain = (candidate.word, candidate.where), solve_shares(part, part.candidates)[1]
        if key not in best or gain > best[key][0]:
            best[key] = (gain, k)
    found = []
    for _, k in best.values():
        found.append((k, refine(design, (*beside, k)).design.candidates[-1].settings[0]))
    return design.with_settings(found)
