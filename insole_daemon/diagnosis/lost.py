"""Readings that did not come, and readings that came again as if they were new."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..physics.law import Array
from ..recording.loading import FootRecording
from ..skin.geometry import N_TAXELS, PRESSURE_TAXELS
from .observed import stretches

GAP_PERIODS = 1.6  # between two cycles: some are missing
RARE = 1e-4  # of the cycles: so seldom noise makes a working triangle say the same as before
MOST_REPEATS = 5  # equal readings of all of a triangle in a row: no converter is that slow
MOST_SAME = 0.5  # of the cycles: a triangle that repeats more is read more slowly than it is written down
WINDOW = 100  # cycles over which it is asked how often a taxel says the same twice


def not_new(foot: FootRecording) -> NDArray[np.bool_]:
    """(n, n_triangles) nothing new was read: the frame did not come, or says what the one before it said."""
    found: NDArray[np.bool_] = foot.missing | foot.repeated[:, None]
    pressure = foot.counts[:, :, PRESSURE_TAXELS]
    equal = np.zeros(pressure.shape, bool)
    equal[1:] = pressure[1:] == pressure[:-1]
    same = equal.all(axis=2)
    # What stands at the end of its range may stay.
    same &= (foot.valid & PRESSURE_TAXELS).sum(axis=2) >= N_TAXELS / 2
    for row in range(len(foot.layout)):
        least = _least(equal[:, row], same[:, row])
        for a, b in stretches(same[:, row]):
            if b - a + 1 >= least:
                found[a : b + 1, row] = True
    return found


def gaps(t_s: Array) -> NDArray[np.bool_]:
    """(n,) cycles before which others are missing."""
    gap = np.diff(t_s, prepend=t_s[0])
    found: NDArray[np.bool_] = gap > GAP_PERIODS * np.median(gap)
    return found


def _least(equal: NDArray[np.bool_], same: NDArray[np.bool_]) -> int:
    """How often in a row a triangle may say the same before that is no chance; (n, 10) of each taxel, (n,) of all.

    What chance does is told by the stretches in which it does most, from cycles that are new for sure.
    """
    if same.mean() > MOST_SAME:
        return MOST_REPEATS
    chances = []
    for at in range(0, len(equal), WINDOW):
        new = ~same[at : at + WINDOW]
        if new.sum() >= WINDOW // 4:
            chances.append(float(np.prod(equal[at : at + WINDOW][new].mean(axis=0))))
    if not chances:
        return MOST_REPEATS
    chance = float(np.clip(np.quantile(chances, 0.95), 1e-30, 0.999))
    return int(np.clip(np.ceil(np.log(RARE) / np.log(chance)), 1, MOST_REPEATS))
