"""Changes of the load by the terms of a set along the signal path.

A term acts on the load as the terms before it on the path have changed it: with q₀ the reference and Δ the change by a
term, qₖ = qₖ₋₁ + Δₖ[qₖ₋₁] (formats.md, table of effects).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...physics.law import Array
from ..load_estimate import KnownLoad, TaxelLoad
from .blocks import BlockDesign
from .refine import Refined
from .regression import PlacedTerm

ACTING_ON_LOAD = range(2, 6)  # places on the signal path before the lag, which is a timing, and the static curve

Changes = tuple[tuple[int, Array], ...]


def acts_on_load(candidate: PlacedTerm) -> bool:
    """Return whether a candidate changes the load on which later terms of the signal path act."""
    return candidate.term.order is not None and candidate.term.order in ACTING_ON_LOAD


def load_changes(design: BlockDesign, chosen: Sequence[tuple[PlacedTerm, Array]]) -> Changes:
    """Return the change of the load by each of the candidates `chosen`, with its place on the path.

    `chosen`: candidates that `acts_on_load` accepts, with their shares. The changes, in Pa, broadcast to (N, T, 12).
    """
    known = design.known_load
    load = known if design.seen.is_uniform else TaxelLoad(design.seen, known.changes)
    changes = []
    for candidate, shares in chosen:
        assert candidate.term.order is not None  # as of all that act on the load
        changes.append((candidate.term.order, -pressure_removed(design, load, candidate, shares)))
    return tuple(changes)


def pressure_removed(design: BlockDesign, load: KnownLoad, candidate: PlacedTerm, shares: Array) -> Array:
    """Return the pressure by which a candidate reduces the load, Pa.

    Its shape is (N, T, 1) for a `KnownLoad`, (N, T, 12) for a `TaxelLoad`. It is 0 for a term without columns by
    triangle.
    """
    term = candidate.term
    share_of = [(setting, share) for setting, share in zip(candidate.settings, shares.tolist(), strict=True) if share]
    settings = tuple(setting for setting, _ in share_of)
    nothing = np.zeros((len(design.weights), design.weights.shape[1], 1))
    if not settings:
        return nothing
    if isinstance(load, TaxelLoad):
        load = replace(load, only=settings)
    blocks = term.placed_columns(load) if term.column is None else [term.column_of(load, candidate.settings[0])]
    for block in blocks:
        at = [k for k, setting in enumerate(block.settings) if setting in settings]
        if len(at) == len(settings) and block.by_triangle is not None:
            every = np.zeros(len(block.settings), block.by_triangle.dtype)  # to select columns would copy them
            every[at] = [share for _, share in share_of]
            return np.asarray(block.by_triangle @ every * design.mask[candidate.columns[0]][:, None])
    return nothing


def model_pressure(refined: Refined[BlockDesign]) -> Array:
    """Return the pressure (N, T, 12) in Pa that the static curves read by a refined set under the load of its rows."""
    design = refined.design
    load = TaxelLoad(design.seen, design.known_load.changes)
    pressure_pa = np.broadcast_to(design.seen.load_pa(design.seen.reference_s), design.seen.activation_count.shape)
    for candidate, shares in zip(design.candidates, refined.shares, strict=True):
        pressure_pa = pressure_pa - pressure_removed(design, load, candidate, shares)
    return np.asarray(pressure_pa)
