"""Strong snaps at the very thresholds at which they explain most: beside a grid's, others would describe the rest."""

from __future__ import annotations

from ...physics.effect import Where
from ..model.blocks import BlockDesign
from ..model.refine import refine
from ..terms.term import Setting

UPPER = "up_pa"
LEAST_SHARE = 0.05  # of the squared residual, that the strongest explains alone
COMPARABLE = 0.1  # of the strongest, that another place's explains
STARTS = 2  # of the grid at a place: between them a better one may lie behind a worse
MOST_PLACES = 8


def best_thresholds(design: BlockDesign) -> list[tuple[int, Setting]]:
    """Numbers of candidates, one at each place where a snap explains much, and their best settings.

    Under a load that is the same everywhere: another one has all thresholds on the way, each at its own time.
    """
    if not design.seen.is_uniform:
        return []
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
        return []
    found = []
    for each in starts:
        if each[0][0] > COMPARABLE * strongest:
            refined = max((refine(design, (k,)) for _, k in each), key=lambda one: one.gain)
            found.append((each[0][1], refined.design.candidates[0].settings[0]))
    return found
