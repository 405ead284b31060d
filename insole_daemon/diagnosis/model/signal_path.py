"""How the terms of a set change the load on its way to the readings.

A term acts on what those before it on the signal path have made of the load: with q₀ the reference and Δ the change
that a term makes, qₖ = qₖ₋₁ + Δₖ[qₖ₋₁] (formats.md, table of effects).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from .blocks import BlockDesign
from .load import KnownLoad, TaxelLoad
from .regression import PlacedTerm

ACTING_ON_LOAD = range(2, 6)  # places on the signal path: the lag after them is a timing, the static curve ends it

Changes = tuple[tuple[int, Array], ...]


def load_changes(design: BlockDesign, chosen: Sequence[PlacedTerm], shares: Sequence[Array]) -> Changes:
    """Returns by how much each of `chosen` changes the load, Pa, arrays that broadcast to (N, T, 12), by its order."""
    known = design.known_load
    load = known if design.seen.is_uniform else TaxelLoad(design.seen, known.changes)
    changes = []
    for candidate, own_shares in zip(chosen, shares, strict=True):
        order = candidate.term.order
        if order is not None and order in ACTING_ON_LOAD:
            changes.append((order, -pressure_removed(design, load, candidate, own_shares)))
    return tuple(changes)


def pressure_removed(design: BlockDesign, load: KnownLoad, candidate: PlacedTerm, shares: Array) -> Array:
    """Returns what a candidate takes of the load, Pa: (N, T, 1) of a `KnownLoad`, (N, T, 12) of a `TaxelLoad`.

    0 of a term that has no columns by triangle.
    """
    term, settings = candidate.term, candidate.settings
    blocks = term.placed_columns(load) if term.column is None else [term.column_of(load, settings[0])]
    for block in blocks:
        at = [k for k, setting in enumerate(block.settings) if setting in settings]
        if len(at) == len(settings) and block.by_triangle is not None:
            return np.asarray(block.by_triangle[..., at] @ shares * design.mask[candidate.columns[0]][:, None])
    return np.zeros((len(design.weights), design.weights.shape[1], 1))
