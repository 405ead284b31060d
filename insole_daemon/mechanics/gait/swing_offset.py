"""Offset of the wrench from swing to swing: what an insole reads when nothing loads it.

Sensors drift with temperature, and straps press. The median over each swing is zero load by definition, and between
swings the offset is taken as linear.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .contacts import Contacts

LONGEST_PART_S = 2.0  # of a pause in the air; of a longer one, the first and the last second count
_EDGE_FRACTION = 0.2  # of a swing at both ends, where the foot may still or already press
_FEWEST_SAMPLES = 3


def swing_samples(t_s: NDArray[np.float64], contacts: Contacts) -> list[NDArray[np.intp]]:
    """Return the samples of `t_s` (n,) within each swing between the stances `contacts`, without its ends."""
    if not len(contacts):
        return []
    bounds = [-1, *np.stack([contacts.first, contacts.last], axis=-1).ravel().tolist(), len(t_s)]
    swings = list(pairwise(bounds))[::2]
    return [samples for last, first in swings for samples in _inner_samples(t_s, last + 1, first)]


def swing_offset(
    t_s: NDArray[np.float64], loads: NDArray[np.float64], swings: list[NDArray[np.intp]]
) -> NDArray[np.float64]:
    """Return the (k, n) offset of `loads` (k, n) at `t_s` (n,), of which the first row is f_z; 0 without any swing."""
    at_s, offsets = [], []
    for samples in swings:
        known = samples[np.isfinite(loads[0, samples])]
        if len(known) >= _FEWEST_SAMPLES:
            at_s.append(float(np.mean(t_s[known])))
            offsets.append(np.median(loads[:, known], axis=1))
    if not offsets:
        return np.zeros_like(loads)
    return np.stack([np.interp(t_s, at_s, column) for column in np.array(offsets).T])


def _inner_samples(t_s: NDArray[np.float64], first: int, end: int) -> list[NDArray[np.intp]]:
    samples = np.arange(first, end)
    if not len(samples):
        return []
    begin_s, length_s = float(t_s[first]), float(t_s[end - 1] - t_s[first])
    if length_s > LONGEST_PART_S:
        since_s = t_s[samples] - begin_s
        edge_s = LONGEST_PART_S / 2
        return [samples[since_s <= edge_s], samples[since_s >= length_s - edge_s]]
    edge_s = _EDGE_FRACTION * length_s
    return [samples[(t_s[samples] >= begin_s + edge_s) & (t_s[samples] <= begin_s + length_s - edge_s)]]
