"""Strong snaps at the very thresholds at which they explain most: beside a grid's, others would describe the rest."""

from __future__ import annotations

from ...physics.effect import Where
from ..model.blocks import BlockDesign
from ..model.refine import refine
from ..model.solve import solve_shares
from ..terms.term import Setting

UPPER = "up_pa"
LEAST_SHARE = 0.05  # of the squared residual, that the strongest explains alone
COMPARABLE = 0.1  # of the strongest, that another place's explains


def best_thresholds(design: BlockDesign) -> list[tuple[int, Setting]]:
    """Numbers of candidates, one at each place where a snap explains much, and their best settings."""
    best: dict[Where, tuple[float, int]] = {}
    for k, candidate in enumerate(design.candidates):
        if UPPER in candidate.term.refine:
            part = design.subset([k])
            gain = solve_shares(part, part.candidates)[1]
            if candidate.where not in best or gain > best[candidate.where][0]:
                best[candidate.where] = (gain, k)
    strongest = max((gain for gain, _ in best.values()), default=0.0)
    if strongest < LEAST_SHARE * design.total:
        return []
    strong = [k for gain, k in best.values() if gain > COMPARABLE * strongest]
    return [(k, refine(design, (k,)).design.candidates[0].settings[0]) for k in strong]
