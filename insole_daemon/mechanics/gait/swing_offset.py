"""What an insole reads in swing, when nothing loads it: the offset of the wrench, from swing to swing.

Sensors drift with temperature and keep a memory of the last step; straps press. The median over each swing is zero load
by definition, and between swings the offset is taken as linear.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .contacts import find_contacts

LONGEST_PART_S = 2.0  # of a pause in the air; of a longer one, the first and the last second count
_EDGE = 0.2  # of a swing at both ends, where the foot may still or already press
_FEWEST = 3  # samples


def swing_offset(t_s: NDArray[np.float64], loads: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k, n) offset of loads (k, n) at t_s (n,), of which the first row is f_z; 0 where there is no swing at all."""
    contacts = find_contacts(t_s, loads[0])
    if not len(contacts):
        return np.zeros_like(loads)
    bounds = [-1, *np.stack([contacts.first, contacts.last], axis=-1).ravel().tolist(), len(t_s)]
    at_s, offsets = [], []
    for last, first in list(pairwise(bounds))[::2]:
        for rows in _parts(t_s, last + 1, first):
            known = rows[np.isfinite(loads[0, rows])]
            if len(known) >= _FEWEST:
                at_s.append(float(np.mean(t_s[known])))
                offsets.append(np.median(loads[:, known], axis=1))
    if not offsets:
        return np.zeros_like(loads)
    return np.stack([np.interp(t_s, at_s, column) for column in np.array(offsets).T])


def _parts(t_s: NDArray[np.float64], first: int, end: int) -> list[NDArray[np.intp]]:
    rows = np.arange(first, end)
    if not len(rows):
        return []
    begin_s, length_s = float(t_s[first]), float(t_s[end - 1] - t_s[first])
    if length_s > LONGEST_PART_S:
        since_s = t_s[rows] - begin_s
        edge_s = LONGEST_PART_S / 2
        return [rows[since_s <= edge_s], rows[since_s >= length_s - edge_s]]
    inner = (t_s[rows] >= begin_s + _EDGE * length_s) & (t_s[rows] <= begin_s + (1 - _EDGE) * length_s)
    return [rows[inner]]
