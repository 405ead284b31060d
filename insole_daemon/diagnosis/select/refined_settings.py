"""Further candidates with refined settings, beside those of the grid."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ...physics.effect import Where
from ..model.blocks import BlockDesign
from ..model.regression import PlacedTerm
from ..terms.term import Setting

RefinedSettings = Mapping[tuple[str, Where], Setting]  # by word and place


def with_refined(design: BlockDesign, settings: RefinedSettings) -> BlockDesign:
    """Return `design` with a further candidate for each of `settings` of which it has the word at the place."""
    on_grid = {(one.word, one.where): k for k, one in enumerate(design.candidates) if _is_of_grid(one)}
    return design.with_settings([(on_grid[key], setting) for key, setting in settings.items() if key in on_grid])


def _is_of_grid(candidate: PlacedTerm) -> bool:
    """Return whether the columns of a candidate are those of a setting, and no joint course over time."""
    return candidate.term.column is not None and not any(map(math.isnan, candidate.settings[0].values()))
