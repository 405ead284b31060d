"""Readings of cycles as a signal, with gaps filled.

A straight line bridges a reading or two. Over a longer gap the load goes its own way, of which the other taxels know:
what one says is a mixture of what the others say at the same moment, as far as they have much in common.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..physics.law import Array

SHORT_S = 0.15  # a gap that a straight line bridges
MIXTURES = 8  # of the half of the taxels with the fewest gaps, that tell the others


def bridged(count: Array, believed: NDArray[np.bool_], cycle_s: Array) -> Array:
    """(n, m) counts with what the other taxels say in the place of gaps longer than SHORT_S.

    `believed` (n, m): readings that are; `cycle_s` (n,). A taxel without any stays as it is.
    """
    row = np.arange(len(cycle_s))[:, None]
    before = np.maximum.accumulate(np.where(believed, row, 0), axis=0)
    after = np.minimum.accumulate(np.where(believed, row, len(cycle_s) - 1)[::-1], axis=0)[::-1]
    gap = ~believed & (cycle_s[after] - cycle_s[before] > SHORT_S)
    found = count.copy()
    columns = np.flatnonzero(gap.any(axis=0) & believed.any(axis=0))
    if columns.size:
        much = gap.mean(axis=0)
        telling = count[:, much <= np.median(much)]
        telling = telling - telling.mean(axis=0)
        _, axes = np.linalg.eigh(telling.T @ telling)
        mixed = np.concatenate([np.ones((len(count), 1)), telling @ axes[:, -MIXTURES:]], axis=1)
    for column in columns:
        out = gap[:, column]
        found[out, column] = mixed[out] @ np.linalg.lstsq(mixed[~out], count[~out, column], rcond=None)[0]
    return found
