"""Detect outliers: readings of single taxels that contradict those before, after and around them.

Bit errors and electrical glitches make them. An outlier carries no information on the load and is interpolated. A
change that several taxels of a triangle show at once is load; one that lasts may be load; one that a taxel shows often
is an effect: none of these is an outlier.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter1d

from ...physics.law import Array
from ...skin.geometry import PRESSURE_TAXELS
from ..floor import noise_of_blocks

MOST_APART_S = 0.12  # between the readings before and after, two of a board at 50 ms: a load may come and go meanwhile
LEAST_SIGMAS = 8.0  # of the noise nearby: probability 10⁻¹⁵
LEAST_NOISE_COUNT = 0.5  # of readings that rounding makes equal
SHARED = 0.4  # share of a triangle's live taxels whose common change is load; three of ten may have outliers at once
LEAST_LIVE = 4  # taxels: fewer do not contradict an outlier
LEAST_RATIO = 4.0  # of the deviation to the largest that SHARED of the taxels have
LEAST_MOVE_SHARE = 0.5  # ratio of the deviation to the change meanwhile that SHARED of the taxels have
NOISE_READINGS = 32  # of a stretch for the level of the noise
PASSES = 2  # of two adjacent outliers the larger one hides the other
MOST_FRACTION = 0.05  # of a taxel's readings: more are an effect


def outliers(t_s: Array, counts: Array, valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the outliers (k, 12) among the `valid` readings `counts` (k, 12) of one triangle at times (k,)."""
    is_outlier = np.zeros(counts.shape, bool)
    if len(counts) < 2 * NOISE_READINGS:
        return is_outlier
    live = PRESSURE_TAXELS & valid.any(axis=0) & (np.ptp(counts, axis=0) > 0)
    if live.sum() < LEAST_LIVE:
        return is_outlier
    rank_shared = round(SHARED * live.sum())
    noise = _noise_nearby(counts)

    def significant(deviations: Array, changes: Array) -> Array:  # (k, 12); 0 where load or noise may explain them
        shared_level = [np.sort(values[:, live], axis=1)[:, -rank_shared, None] for values in (deviations, changes)]
        threshold = np.maximum(LEAST_RATIO * shared_level[0], LEAST_MOVE_SHARE * shared_level[1])
        return np.where(deviations > np.maximum(threshold, LEAST_SIGMAS * noise), deviations, 0.0)

    for _ in range(PASSES):
        before, after = _good_neighbours(valid & ~is_outlier)
        known = valid & ~is_outlier & _is_brief(t_s, before, after)
        deviation = significant(*_beyond_neighbours(counts, counts, known, before, after))
        is_largest = (deviation > 0) & (deviation >= maximum_filter1d(deviation, 3, axis=0))
        if not is_largest.any():
            break
        is_outlier |= is_largest
    # Two adjacent outliers of the same size hide each other: judge them as one.
    before, after = _good_neighbours(valid & ~is_outlier)
    later = np.take_along_axis(after, after, axis=0)
    known = valid & ~is_outlier & _is_brief(t_s, before, later)
    next_counts = np.take_along_axis(counts, after, axis=0)
    first_is_far, second_is_far = (
        significant(*_beyond_neighbours(judged, counts, known, before, later)) > 0 for judged in (counts, next_counts)
    )
    rows, taxels = np.nonzero(first_is_far & second_is_far)
    is_outlier[rows, taxels] = True
    is_outlier[after[rows, taxels], taxels] = True
    return np.asarray(is_outlier & (is_outlier.mean(axis=0) <= MOST_FRACTION * valid.mean(axis=0)))


def interpolated(t_s: Array, counts: Array, is_good: NDArray[np.bool_], wrong: NDArray[np.bool_]) -> Array:
    """Return `counts` (k, 12) with `wrong` readings replaced by cubics through those that are `is_good` (k, 12)."""
    corrected = counts.copy()
    for taxel in np.flatnonzero(wrong.any(axis=0)):
        good_s, good_counts = t_s[is_good[:, taxel]], counts[is_good[:, taxel], taxel]
        values = CubicSpline(good_s, good_counts)(np.clip(t_s[wrong[:, taxel]], good_s[0], good_s[-1]))
        corrected[wrong[:, taxel], taxel] = np.clip(values, good_counts.min(), good_counts.max())
    return corrected


def _good_neighbours(is_good: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the rows (k, 12) of the `good` readings before and after each; at an end the one neighbour twice."""
    k = len(is_good)
    rows = np.where(is_good, np.arange(k)[:, None], -1)
    before = np.maximum.accumulate(np.concatenate([np.full_like(rows[:1], -1), rows[:-1]]), axis=0)
    rows = np.where(is_good, rows, k)
    after = np.minimum.accumulate(np.concatenate([rows[1:], np.full_like(rows[:1], k)])[::-1], axis=0)[::-1]
    return np.where(before < 0, after, before).clip(0, k - 1), np.where(after == k, before, after).clip(0, k - 1)


def _is_brief(t_s: Array, before: NDArray[np.intp], after: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return whether the readings before and after are too near in time for a load to come and go (k, 12)."""
    apart_s = np.maximum(t_s[after], t_s[:, None]) - np.minimum(t_s[before], t_s[:, None])
    return np.asarray(apart_s < MOST_APART_S)


def _beyond_neighbours(
    judged: Array, counts: Array, known: NDArray[np.bool_], before: NDArray[np.intp], after: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Return by how much `judged` lies outside the readings `before` and `after`, and their difference, (k, 12) each.

    Both are 0 where not `known`.
    """
    first, second = (np.take_along_axis(counts, rows, axis=0) for rows in (before, after))
    outside = np.abs(judged - np.clip(judged, np.minimum(first, second), np.maximum(first, second)))
    return np.where(known, outside, 0.0), np.where(known, np.abs(second - first), 0.0)


def _noise_nearby(counts: Array) -> Array:
    """Return the standard deviation (k, 12) of readings: the largest of a stretch and those beside it."""
    stretches = np.array_split(counts, len(counts) // NOISE_READINGS)
    level = maximum_filter1d(np.stack([noise_of_blocks(stretch) for stretch in stretches]), 3, axis=0)
    nearby = np.repeat(level, [len(stretch) for stretch in stretches], axis=0)
    return np.asarray(np.maximum(nearby, LEAST_NOISE_COUNT))
