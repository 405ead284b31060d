"""Places on an insole: sets of taxels as whole insole, boards, triangles or taxels, and in words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..physics.effect import Where
from ..physics.law import SCOPES
from ..skin.geometry import N_TAXELS
from ..skin.layout import Layout

MOST_OF = 0.75  # of the usable taxels of a board or triangle: the place is then that board or triangle
MOST_TRIANGLES = 0.9  # of a board or the insole: the place is then that board or the insole


def where(slots: NDArray[np.intp], usable: NDArray[np.intp], layout: Layout) -> Where:
    """Return the coarsest place that consists of `slots`; `usable` are all slots that were examined."""
    if len(slots) >= MOST_OF * len(usable):
        return Where()
    identities = layout.identities
    chosen = set(slots.tolist())
    places: list[tuple[int, list[int]]] = []  # depth, slots
    for depth in (1, 2):  # board, triangle
        groups: dict[tuple[int, ...], list[int]] = {}
        for slot in usable.tolist():
            groups.setdefault(tuple(identities[slot // N_TAXELS].tolist()[:depth]), []).append(slot)
        for group in groups.values():
            inside = [slot for slot in group if slot in chosen]
            if len(inside) >= MOST_OF * len(group) and len(group) > 1:
                places.append((depth, group))
                chosen -= set(group)
    places += [(3, [slot]) for slot in sorted(chosen)]
    finest = max(depth for depth, _ in places)
    ids = sorted({_taxel(slot, layout)[:finest] for _, group in places for slot in group})
    return Where(SCOPES[finest], tuple(ids))


def place_of_triangles(rows: Sequence[int], layout: Layout) -> Where:
    """Return the coarsest place that consists of the triangles `rows`, or of which nearly all are among them."""
    identities = [tuple(identity) for identity in layout.identities.tolist()]
    if len(rows) >= MOST_TRIANGLES * len(identities):
        return Where()
    boards = sorted({identities[row][0] for row in rows})
    of_boards = [row for row, identity in enumerate(identities) if identity[0] in boards]
    if len(rows) >= MOST_TRIANGLES * len(of_boards):
        return Where("board", tuple((board,) for board in boards))
    return Where("triangle", tuple(identities[row] for row in rows))


def merged(sets: Iterable[NDArray[np.intp]]) -> NDArray[np.intp]:
    """Return all slots of `sets`, each once."""
    arrays = list(sets)
    return np.unique(np.concatenate(arrays)) if arrays else np.empty(0, np.intp)


def place_in_words(place: Where) -> str:
    """Return `place` in words."""
    if place.scope == "insole":
        return "the whole insole"
    names = [".".join(map(str, identity)) for identity in place.ids]
    plural = "s" if len(names) > 1 else ""
    return f"{place.scope}{plural} {', '.join(names[:6])}{f' and {len(names) - 6} more' if len(names) > 6 else ''}"


def _taxel(slot: int, layout: Layout) -> tuple[int, ...]:
    return (*layout.identities[slot // N_TAXELS].tolist(), slot % N_TAXELS)
