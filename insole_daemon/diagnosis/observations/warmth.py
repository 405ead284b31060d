"""How warm the insole is, by its thermal pads, where no thermometer was recorded.

Two pads of every triangle bear no load and follow the temperature. How many counts a kelvin moves them is not known, so
the course is in their counts.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from ...physics.law import Array
from ...skin.geometry import PRESSURE_TAXELS
from .wrench import WrenchObservation

PADS = np.flatnonzero(~PRESSURE_TAXELS).tolist()
SMOOTH_S = 2.0  # temperature moves no faster
LEAST_PADS = 4
MOST_CUT_OFF = 0.05  # of a pad's readings at an end of their range
LEAST_ALIKE = 0.9  # correlation of one half of the pads with the other
LIKE_LOAD = 0.7  # correlation with the readings, from which on it is the load that the pads follow


def with_warmth(seen: WrenchObservation) -> WrenchObservation:
    """`seen` with the course of its thermal pads, where it has no temperature and they agree on one."""
    if seen.temperature_c is not None:
        return seen
    course = pad_course(seen)
    return seen if course is None else replace(seen, temperature_c=course, warmth_is_of_pads=True)


def pad_course(seen: WrenchObservation) -> Array | None:
    """(N,) counts, by which pads say that it is warmer or colder than in the middle; None where they say nothing."""
    there = [each for each in seen.readings if len(each.t_s) > 1]
    every = [np.interp(seen.t_s, each.t_s, each.counts[:, pad]) for each in there for pad in PADS]
    counts = np.stack(every, axis=1) if every else np.empty((len(seen.t_s), 0))
    tells = np.mean((counts <= 0.5) | (counts >= 254.5), axis=0) < MOST_CUT_OFF
    counts = counts[:, tells & (np.ptp(counts, axis=0) > 0.0)]
    if counts.shape[1] < LEAST_PADS:
        return None
    size = max(round(SMOOTH_S / seen.step_s), 3)
    smooth = uniform_filter1d(counts - np.median(counts, axis=0), size, axis=0)
    halves = [np.median(smooth[:, k::2], axis=1) for k in (0, 1)]
    load = uniform_filter1d(seen.activation_count[:, seen.usable].mean(axis=1), size)
    course = np.median(smooth, axis=1)
    if min(float(np.ptp(each)) for each in (*halves, load)) <= 0.0:
        return None
    if np.corrcoef(*halves)[0, 1] < LEAST_ALIKE or abs(np.corrcoef(course, load)[0, 1]) > LIKE_LOAD:
        return None
    return np.asarray(course)
