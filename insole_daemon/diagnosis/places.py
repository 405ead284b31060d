"""Where on an insole: sets of taxels, and the largest parts that say the same."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ..physics.effect import Where
from ..physics.law import SCOPES
from ..skin.geometry import N_TAXELS
from ..skin.layout import Layout

MOST_OF = 0.75  # of a part's usable taxels: the part is meant, not the taxels that are


def where(slots: NDArray[np.intp], usable: NDArray[np.intp], layout: Layout) -> Where:
    """The coarsest parts of the insole that `slots` are; `usable` are all that were asked."""
    if len(slots) >= MOST_OF * len(usable):
        return Where()
    identities = layout.identities
    chosen = set(slots.tolist())
    found: list[tuple[int, list[int]]] = []  # depth, slots
    for depth in (1, 2):  # board, triangle
        parts: dict[tuple[int, ...], list[int]] = {}
        for slot in usable.tolist():
            parts.setdefault(tuple(identities[slot // N_TAXELS].tolist()[:depth]), []).append(slot)
        for own in parts.values():
            inside = [slot for slot in own if slot in chosen]
            if len(inside) >= MOST_OF * len(own) and len(own) > 1:
                found.append((depth, own))
                chosen -= set(own)
    found += [(3, [slot]) for slot in sorted(chosen)]
    finest = max(depth for depth, _ in found)
    ids = sorted({_taxel(slot, layout)[:finest] for _, own in found for slot in own})
    return Where(SCOPES[finest], tuple(ids))


def merged(parts: Iterable[NDArray[np.intp]]) -> NDArray[np.intp]:
    """All slots of `parts`, each once."""
    every = list(parts)
    return np.unique(np.concatenate(every)) if every else np.empty(0, np.intp)


def said(place: Where) -> str:
    """`place` in words."""
    if place.scope == "insole":
        return "the whole insole"
    names = [".".join(map(str, identity)) for identity in place.ids]
    plural = "s" if len(names) > 1 else ""
    return f"{place.scope}{plural} {', '.join(names[:6])}{f' and {len(names) - 6} more' if len(names) > 6 else ''}"


def _taxel(slot: int, layout: Layout) -> tuple[int, ...]:
    return (*layout.identities[slot // N_TAXELS].tolist(), slot % N_TAXELS)
