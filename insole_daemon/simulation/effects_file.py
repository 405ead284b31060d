"""A file of effects (`insole-effects/1`), shared out to the feet whose boards it names."""

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
    """The effects in file `path`, by foot; DocumentError lists all that is wrong with it.

    `layouts`: of all feet. What is on the whole insole is on each of them.
    """
    together = replace(
        layouts[0],
        triangles=tuple(triangle for layout in layouts for triangle in layout.triangles),
        xy_m=np.concatenate([layout.xy_m for layout in layouts]),
    )
    effects = effects_document.load(path, together)
    return {layout.foot: tuple(_of(effects, layout, path)) for layout in layouts}


def _of(effects: Sequence[Effect], layout: Layout, path: str | PathLike[str]) -> list[Effect]:
    boards = {triangle.board for triangle in layout.triangles}
    found = []
    for effect in effects:
        if effect.law.word == "swapped_triangles":
            on = {int(board) in boards for board, _ in effect.values["pair"]}
            if len(on) > 1:
                raise SimulationError(
                    f"{path}: swapped_triangles: parameters.pair: expected two triangles of one foot, "
                    f"found {effect.values['pair'].astype(int).tolist()}"
                )
            if not on.pop():
                continue
        elif effect.where.scope != "insole":
            ids = tuple(identity for identity in effect.where.ids if identity[0] in boards)
            if not ids:
                continue
            effect = replace(effect, where=Where(effect.where.scope, ids))
        found.append(effect)
    return found


Effects = Mapping[Foot, Sequence[Effect]]
