"""The laws that come nearest to effects which were found with what laws leave out of real materials.

A regression finds the effect of a memory with columns beside its law's that no model has. Fitted to the rows without
these, the law alone would describe the rows' other parts where it fails, and hardly the effect.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from .blocks import MISFITS, BlockDesign
from .regression import PlacedTerm, Regression
from .solve import solve_companions, solve_shares

IN_NO_MODEL = MISFITS | {"earlier_load"}  # a law knows of no load before the recording


def nearest_laws(design: Regression, shares: Array) -> Array:
    """Returns the shares (p,) of the laws alone that come nearest to the effect of `shares` (p,).

    Columns that no model has get none; static columns beside a law get what makes up the difference in its mean curve.
    """
    memories = [each for each in design.candidates if MISFITS & set(each.companion_words)]
    if not (memories and isinstance(design, BlockDesign)):
        return shares
    own = np.concatenate([each.columns for each in memories])
    left_out = np.concatenate([_columns_of(each, MISFITS) for each in memories])
    effect = np.zeros_like(shares)
    effect[own], effect[left_out] = shares[own], shares[left_out]
    target = design.gram @ effect
    alone = [each.without(IN_NO_MODEL) for each in memories]
    found, _ = solve_shares(design, alone, target)
    beside, static = solve_companions(design, alone, found, target)
    nearest = shares.copy()
    nearest[np.concatenate([_columns_of(each, IN_NO_MODEL) for each in memories])] = 0.0
    nearest[own] = np.concatenate(found)
    nearest[beside] += static
    return nearest


def every_share(design: Regression, chosen: Sequence[PlacedTerm], shares: Sequence[Array]) -> Array:
    """Returns the shares (p,) of all columns: those of the candidates `chosen`, and of what is fitted beside them."""
    found = np.zeros(len(design.cross))
    if chosen:
        beside, companions = solve_companions(design, chosen, shares)
        found[np.concatenate([each.columns for each in chosen])] = np.concatenate(shares)
        found[beside] = companions
    return found


def _columns_of(candidate: PlacedTerm, words: frozenset[str]) -> NDArray[np.intp]:
    beside = zip(candidate.companions.tolist(), candidate.companion_words, strict=True)
    return np.array([column for column, word in beside if word in words], np.intp)
