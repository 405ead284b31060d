"""Load a file of effects (`insole-effects/1`), and assign each effect to the feet whose boards it names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike

import numpy as np

from ..errors import SimulationError
from ..physics import effects_document
from ..physics.effect import Effect, Where
from ..skin.layout import Foot, Layout


def load(path: str | PathLike[str], layouts: Sequence[Layout]) -> dict[Foot, tuple[Effect, ...]]:
    """Load the effects in file `path`, by foot; DocumentError lists all problems.

    `layouts` are those of all feet. An effect on the whole insole applies to each of them.
    """
    both_feet = replace(
        layouts[0],
        triangles=tuple(triangle for layout in layouts for triangle in layout.triangles),
        xy_m=np.concatenate([layout.xy_m for layout in layouts]),
    )
    effects = effects_document.load(path, both_feet)
    return {layout.foot: tuple(_select_for_foot(effects, layout, path)) for layout in layouts}


def _select_for_foot(effects: Sequence[Effect], layout: Layout, path: str | PathLike[str]) -> list[Effect]:
    """Return the effects that apply to the boards of `layout`."""
    boards = {triangle.board for triangle in layout.triangles}
    selected = []
    for effect in effects:
        if effect.law.word == "swapped_triangles":
            is_on_foot = {int(board) in boards for board, _ in effect.values["pair"]}
            if len(is_on_foot) > 1:
                raise SimulationError(
                    f"{path}: swapped_triangles: parameters.pair: expected two triangles of one foot, "
                    f"found {effect.values['pair'].astype(int).tolist()}"
                )
            if not is_on_foot.pop():
                continue
        elif effect.where.scope != "insole":
            ids = tuple(identity for identity in effect.where.ids if identity[0] in boards)
            if not ids:
                continue
            effect = replace(effect, where=Where(effect.where.scope, ids))
        selected.append(effect)
    return selected


Effects = Mapping[Foot, Sequence[Effect]]
