"""Estimate the course of the temperature by the thermal pads, if no thermometer was recorded.

The two pads of every triangle bear no load and follow the temperature. Their sensitivity is unknown, so the course is
in counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.stats import norm

from ...physics.law import Array
from ...skin.geometry import N_TAXELS, PRESSURE_TAXELS
from ..finding import Finding
from .common_course import common_course
from .readings import MOST_COUNT
from .wrench import WrenchObservation

PADS = np.flatnonzero(~PRESSURE_TAXELS).tolist()
WINDOW_S = 2.0  # of the moving average: temperature changes slowly
LEAST_PADS = 4
HALF_COUNT = 0.5  # of a pad: what the cutting off of whole counts loses on average
MOST_CUT_OFF = 0.05  # of a pad's readings at an end of their range
MOST_AT_END = 0.8  # of a pad's readings in a window: beyond it the error of its level is five times that of their mean
LEAST_AT_END = 0.05  # of a pad's readings in a window, at the end and not near it: for the window to show the noise
FAR_SIGMAS = 6.0  # of a pad's noise from an end of its range: none of its readings are cut off
LEAST_STD_COUNT = 0.1  # of a pad's mean in a window
LEAST_CORRELATION = 0.9  # of one half of the pads with the other
MOST_OF_LOAD = 0.5  # of the pads' slow course that the load may cause: with more, the pads follow the load


def with_pad_temperature(
    seen: WrenchObservation, whole: WrenchObservation, rezeros: Sequence[Finding]
) -> WrenchObservation:
    """Return `seen` with the course of its thermal pads, if it has no temperature and the pads agree.

    `whole`: the observation of all rows, as it was before the `rezeros` of boards were found.
    """
    if seen.temperature_c is not None:
        return seen
    course = pad_course(whole, rezeros)
    if course is None:
        return seen
    return replace(seen, temperature_c=np.interp(seen.t_s, whole.t_s, course), temperature_is_in_counts=True)


def rounding_of_compensation(seen: WrenchObservation) -> Array:
    """Return how much of its largest rounding error the firmware's temperature compensation makes, (N,) from -1 to 1.

    The firmware subtracts a share of what a pad has moved since the baseline was taken, in whole units of a count, cut
    off: nothing at first, then half a unit too little on average. This is the pads' mean change since the first
    WINDOW_S in halves of a count; 0 if no pads are in range, or if they follow the load.
    """
    counts = _moving_pads(seen)
    if counts.shape[1] < LEAST_PADS:
        return np.zeros(len(seen.t_s))
    mean = counts.mean(axis=1)
    smooth = uniform_filter1d(mean, _window_rows(seen))
    if _follows_load(mean, seen):
        return np.zeros(len(seen.t_s))
    return np.asarray(np.tanh((smooth[0] - smooth) / HALF_COUNT))


def pad_course(seen: WrenchObservation, rezeros: Sequence[Finding]) -> Array | None:
    """Return the course (N,) that the pads share, in counts of the median pad, or None if they do not agree.

    A pad shows nothing while it is at an end of its range. A re-zero of its board moves it.
    """
    counts, row_of_pad = _pads(seen)
    rows = _window_rows(seen)
    m = len(counts) // rows
    if not m or counts.shape[1] < LEAST_PADS:
        return None
    values, known = _levels(counts[: m * rows].reshape(m, rows, -1))
    segment = np.zeros(known.shape, np.intp)
    for rezero in rezeros:
        window = int(np.searchsorted(seen.t_s, float(rezero.parameters["t_s"].value))) // rows
        of_board = np.isin(row_of_pad, rezero.where.slots(seen.layout) // N_TAXELS)
        known[window : window + 1, of_board] = False
        segment[window:, of_board] += 1
    moving = np.ma.filled(np.ma.ptp(np.ma.masked_array(values, ~known), axis=0), 0.0) > 0.0
    if np.count_nonzero(moving) < LEAST_PADS:
        return None
    shared = common_course(values[:, moving], known[:, moving], segment[:, moving], LEAST_STD_COUNT)
    if shared is None or shared.agreement < LEAST_CORRELATION:
        return None
    course = np.interp(np.arange(len(counts)), (np.arange(m) + 0.5) * rows - 0.5, shared.course)
    return None if _follows_load(counts.mean(axis=1), seen) else np.asarray(course)


def _pads(seen: WrenchObservation) -> tuple[Array, NDArray[np.intp]]:
    """Return the counts (N, p) of the pads of all triangles that send, and the triangle's row (p,) of each."""
    sending = [row for row, readings in enumerate(seen.readings) if len(readings.t_s) > 1]
    pads = [(seen.readings[row], pad) for row in sending for pad in PADS]
    series = [np.interp(seen.t_s, readings.t_s, readings.counts[:, pad]) for readings, pad in pads]
    counts = np.stack(series, axis=1) if series else np.empty((len(seen.t_s), 0))
    return counts, np.repeat(np.array(sending, np.intp), len(PADS))


def _levels(in_windows: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the level (m, p) of pads in windows, from readings (m, rows, p) that end at 0 and 255, and whether known.

    Of normal noise with standard deviation σ about a level that is α·σ from the end, the mean of the readings is
    σ·(α·Φ(α) + φ(α)) from it (J. Tobin, Econometrica 26 (1958) 24). σ is that of windows in range; if a pad has none,
    the shares of readings at the end and within the next count give it, whose probits differ by 1/σ.
    """
    is_low = np.median(in_windows, axis=(0, 1)) < MOST_COUNT / 2
    inwards = np.where(is_low, in_windows, MOST_COUNT - in_windows)
    mean, at_end, near_end = inwards.mean(axis=1), (inwards < 0.5).mean(axis=1), (inwards < 1.5).mean(axis=1)

    def distance(alpha: Array) -> Array:
        return np.asarray(alpha * norm.cdf(alpha) + norm.pdf(alpha))

    in_range = at_end == 0.0
    is_partly = (at_end > LEAST_AT_END) & (near_end > at_end) & (near_end < 1.0 - LEAST_AT_END)
    probits = [norm.ppf(np.where(is_partly, share, 0.5)) for share in (at_end, near_end)]
    of_partly = 1.0 / np.where(is_partly, probits[1] - probits[0], 1.0)
    noise = np.where(in_range.any(axis=0), _median(inwards.std(axis=1), in_range), _median(of_partly, is_partly))
    scale = np.maximum(noise, LEAST_STD_COUNT)
    alpha = np.linspace(-FAR_SIGMAS, FAR_SIGMAS, 241)
    level = np.where(mean < FAR_SIGMAS * scale, scale * np.interp(mean / scale, distance(alpha), alpha), mean)
    return np.where(is_low, level, MOST_COUNT - level), (at_end < MOST_AT_END) & np.isfinite(noise)


def _median(values: Array, used: NDArray[np.bool_]) -> Array:
    """Return the median of the used values of each column; NaN if there are none."""
    some = used.any(axis=0)
    median = np.full(values.shape[1], np.nan)
    median[some] = np.nanmedian(np.where(used, values, np.nan)[:, some], axis=0)
    return median


def _is_at_end(counts: Array) -> NDArray[np.bool_]:
    return np.asarray((counts <= 0.5) | (counts >= MOST_COUNT - 0.5))


def _moving_pads(seen: WrenchObservation) -> Array:
    """Return the counts (N, p) of the pads that are in range and do not stand still."""
    counts, _ = _pads(seen)
    in_range = _is_at_end(counts).mean(axis=0) < MOST_CUT_OFF
    return np.asarray(counts[:, in_range & (np.ptp(counts, axis=0) > 0.0)])


def _follows_load(pads: Array, seen: WrenchObservation) -> bool:
    """Return whether most of the slow course of `pads` (N,) is that of the load, or nothing tells it.

    The temperature is constant within a window, so a change of the pads within one is caused by the load. It gives the
    counts of the pads per count of the taxels, and these, times the slow course of the taxels, what the load adds to
    that of the pads. The slow courses alone do not tell: a temperature that changes the taxels much makes them alike.
    """
    load = np.zeros(len(seen.t_s))
    for readings, usable in zip(seen.readings, seen.usable, strict=True):
        if len(readings.t_s) > 1:
            load -= np.interp(seen.t_s, readings.t_s, readings.counts[:, usable].sum(axis=1, dtype=np.float64))
    slow_load, slow_pads = (uniform_filter1d(each, _window_rows(seen)) for each in (load, pads))
    if min(float(np.ptp(slow_pads)), float(np.ptp(slow_load))) <= 0.0:
        return True
    fast_load = load - slow_load
    shown = float(fast_load @ (pads - slow_pads)) / max(float(fast_load @ fast_load), 1e-12)
    return bool(abs(shown) * np.std(slow_load) > MOST_OF_LOAD * np.std(slow_pads))


def _window_rows(seen: WrenchObservation) -> int:
    return max(round(WINDOW_S / seen.step_s), 3)
