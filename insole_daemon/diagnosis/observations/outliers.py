"""Outliers: readings of single taxels that those before, after and beside them contradict.

Bit errors and electrical glitches make them. An outlier says nothing of the load; the taxel's other readings, by which
it is interpolated, say as much as one reading does. What several taxels of a triangle show at once is load, what lasts
may be load, and what a taxel shows often is an effect: they are no outliers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter1d

from ...physics.law import Array
from ...skin.geometry import PRESSURE_TAXELS
from ..floor import noise_of_blocks

LONGEST_S = 0.12  # between the readings before and after, two of a board at 50 ms: a load may come and go meanwhile
LEAST_SIGMAS = 8.0  # of the noise nearby: by chance one of 10¹⁵
LEAST_NOISE_COUNT = 0.5  # of readings that rounding makes alike
TOGETHER = 0.4  # of a triangle's live taxels: what so many show is load; three of ten may be outliers at once
LEAST_LIVE = 4  # of them: fewer contradict nothing
ALONE = 4.0  # times what this taxel is away
MOVES = 0.5  # of what it moves meanwhile: a peak between two readings is no further away
NEARBY = 32  # readings, for the level of the noise
PASSES = 2  # of two outliers side by side the further one hides the other
MOST = 0.05  # of a taxel's readings: more are an effect


def outliers(t_s: Array, counts: Array, valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(k, 12) outliers among the `valid` readings `counts` (k, 12) of one triangle at times (k,)."""
    found = np.zeros(counts.shape, bool)
    live = PRESSURE_TAXELS & valid.any(axis=0) & (np.ptp(counts, axis=0) > 0)
    if len(counts) < 2 * NEARBY or live.sum() < LEAST_LIVE:
        return found
    rank = round(TOGETHER * live.sum())
    noise = _noise_nearby(counts)

    def far(away: Array, moves: Array) -> Array:  # (k, 12) `away`, 0 where load or noise may be as much
        most = [np.sort(each[:, live], axis=1)[:, -rank, None] for each in (away, moves)]
        least = np.maximum(ALONE * most[0], MOVES * most[1])
        return np.where(away > np.maximum(least, LEAST_SIGMAS * noise), away, 0.0)

    for _ in range(PASSES):
        before, after = _beside(valid & ~found)
        known = valid & ~found & _is_brief(t_s, before, after)
        size = far(*_away(counts, counts, known, before, after))
        further = (size > 0) & (size >= maximum_filter1d(size, 3, axis=0))
        if not further.any():
            break
        found |= further
    # Two alike side by side hide each other.
    before, after = _beside(valid & ~found)
    later = np.take_along_axis(after, after, axis=0)
    known = valid & ~found & _is_brief(t_s, before, later)
    next_one = np.take_along_axis(counts, after, axis=0)
    one, other = (far(*_away(each, counts, known, before, later)) > 0 for each in (counts, next_one))
    rows, taxels = np.nonzero(one & other)
    found[rows, taxels] = True
    found[after[rows, taxels], taxels] = True
    return np.asarray(found & (found.mean(axis=0) <= MOST * valid.mean(axis=0)))


def interpolated(t_s: Array, counts: Array, good: NDArray[np.bool_], wrong: NDArray[np.bool_]) -> Array:
    """(k, 12) `counts` with a cubic through the `good` readings (k, 12) of the taxel where they are `wrong`."""
    found = counts.copy()
    for taxel in np.flatnonzero(wrong.any(axis=0)):
        at_s, read = t_s[good[:, taxel]], counts[good[:, taxel], taxel]
        between = CubicSpline(at_s, read)(np.clip(t_s[wrong[:, taxel]], at_s[0], at_s[-1]))
        found[wrong[:, taxel], taxel] = np.clip(between, read.min(), read.max())
    return found


def _beside(good: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """(k, 12) rows of the `good` readings before and after each one; at an end the one on the other side, twice."""
    k = len(good)
    rows = np.where(good, np.arange(k)[:, None], -1)
    before = np.maximum.accumulate(np.concatenate([np.full_like(rows[:1], -1), rows[:-1]]), axis=0)
    rows = np.where(good, rows, k)
    after = np.minimum.accumulate(np.concatenate([rows[1:], np.full_like(rows[:1], k)])[::-1], axis=0)[::-1]
    return np.where(before < 0, after, before).clip(0, k - 1), np.where(after == k, before, after).clip(0, k - 1)


def _is_brief(t_s: Array, before: NDArray[np.intp], after: NDArray[np.intp]) -> NDArray[np.bool_]:
    """(k, 12) whether a load hardly comes and goes between two readings."""
    apart_s = np.maximum(t_s[after], t_s[:, None]) - np.minimum(t_s[before], t_s[:, None])
    return np.asarray(apart_s < LONGEST_S)


def _away(
    own: Array, counts: Array, known: NDArray[np.bool_], before: NDArray[np.intp], after: NDArray[np.intp]
) -> tuple[Array, Array]:
    """(k, 12) by which `own` is beyond the readings `before` and `after`, and these differ; 0 where not `known`."""
    first, second = (np.take_along_axis(counts, each, axis=0) for each in (before, after))
    away = np.abs(own - np.clip(own, np.minimum(first, second), np.maximum(first, second)))
    return np.where(known, away, 0.0), np.where(known, np.abs(second - first), 0.0)


def _noise_nearby(counts: Array) -> Array:
    """(k, 12) standard deviation of readings, the largest of a stretch and those beside it."""
    stretches = np.array_split(counts, len(counts) // NEARBY)
    level = maximum_filter1d(np.stack([noise_of_blocks(each) for each in stretches]), 3, axis=0)
    nearby = np.repeat(level, [len(each) for each in stretches], axis=0)
    return np.asarray(np.maximum(nearby, LEAST_NOISE_COUNT))
