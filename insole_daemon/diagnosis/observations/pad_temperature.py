"""Estimate the course of the temperature by the thermal pads, if no thermometer was recorded.

The two pads of every triangle bear no load and follow the temperature. Their sensitivity is unknown, so the course is
in counts.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from ...physics.law import Array
from ...skin.geometry import PRESSURE_TAXELS
from .wrench import WrenchObservation

PADS = np.flatnonzero(~PRESSURE_TAXELS).tolist()
WINDOW_S = 2.0  # of the moving average: temperature changes slowly
LEAST_PADS = 4
HALF_COUNT = 0.5  # of a pad: what the cutting off of whole counts loses on average
MOST_CUT_OFF = 0.05  # of a pad's readings at an end of their range
LEAST_CORRELATION = 0.9  # of one half of the pads with the other
MOST_LOAD_CORRELATION = 0.7  # with the readings: beyond it the pads follow the load


def with_pad_temperature(seen: WrenchObservation) -> WrenchObservation:
    """Return `seen` with the course of its thermal pads, if it has no temperature and the pads agree."""
    if seen.temperature_c is not None:
        return seen
    course = pad_course(seen)
    return seen if course is None else replace(seen, temperature_c=course, temperature_is_in_counts=True)


def rounding_of_compensation(seen: WrenchObservation) -> Array:
    """Return how much of its largest rounding error the firmware's temperature compensation makes, (N,) from -1 to 1.

    The firmware subtracts a share of what a pad has moved since the baseline was taken, in whole units of a count, cut
    off: nothing at first, then half a unit too little on average. This is the pads' mean change since the first
    WINDOW_S in halves of a count; 0 if no pads are in range, or if they follow the load.
    """
    counts = _moving_pads(seen)
    if counts.shape[1] < LEAST_PADS:
        return np.zeros(len(seen.t_s))
    smooth = uniform_filter1d(counts.mean(axis=1), _window_rows(seen))
    if _follows_load(smooth, seen):
        return np.zeros(len(seen.t_s))
    return np.asarray(np.tanh((smooth[0] - smooth) / HALF_COUNT))


def pad_course(seen: WrenchObservation) -> Array | None:
    """Return the deviation of the pads' counts from their median over time (N,), or None if they do not agree."""
    counts = _moving_pads(seen)
    if counts.shape[1] < LEAST_PADS:
        return None
    window_rows = _window_rows(seen)
    smooth = uniform_filter1d(counts - np.median(counts, axis=0), window_rows, axis=0)
    halves = [np.median(smooth[:, k::2], axis=1) for k in (0, 1)]
    median_course = np.median(smooth, axis=1)
    if min(float(np.ptp(course)) for course in halves) <= 0.0:
        return None
    if np.corrcoef(*halves)[0, 1] < LEAST_CORRELATION or _follows_load(median_course, seen):
        return None
    return np.asarray(median_course)


def _moving_pads(seen: WrenchObservation) -> Array:
    """Return the counts (N, p) of the pads that are in range and do not stand still."""
    sending = [readings for readings in seen.readings if len(readings.t_s) > 1]
    pad_counts = [np.interp(seen.t_s, readings.t_s, readings.counts[:, pad]) for readings in sending for pad in PADS]
    counts = np.stack(pad_counts, axis=1) if pad_counts else np.empty((len(seen.t_s), 0))
    in_range = np.mean((counts <= 0.5) | (counts >= 254.5), axis=0) < MOST_CUT_OFF
    return np.asarray(counts[:, in_range & (np.ptp(counts, axis=0) > 0.0)])


def _follows_load(course: Array, seen: WrenchObservation) -> bool:
    """Return whether a course (N,) of the pads follows the readings of the taxels, or nothing tells it."""
    load = uniform_filter1d(seen.activation_count[:, seen.usable].mean(axis=1), _window_rows(seen))
    if min(float(np.ptp(course)), float(np.ptp(load))) <= 0.0:
        return True
    return bool(abs(np.corrcoef(course, load)[0, 1]) > MOST_LOAD_CORRELATION)


def _window_rows(seen: WrenchObservation) -> int:
    return max(round(WINDOW_S / seen.step_s), 3)
