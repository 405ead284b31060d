"""Detect taxels and triangles without contact: constant readings, leaps, and common failures of a triangle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.stats import poisson

from ..physics.law import Array
from ..skin.geometry import PRESSURE_TAXELS

Times = tuple[tuple[float, float], ...]

CONSTANT_S = 4.0  # longest constant reading of a working taxel while the load changes
LEAST_LOAD_CHANGE = 0.15  # of the insole's range
HIGH_LOAD, STRETCH_LOAD = 0.9, 0.95  # quantiles of the load in the recording, and in a stretch at the end of the range
HIGHEST, MOST_AT_REST = 0.98, 252.0  # quantile of working readings that is without load; below the end of the range
LEAST_BORNE_COUNT = 8.0  # activation that other taxels of the triangle predict
OPEN_S = 0.3  # shortest failure of an open triangle
OPEN_TAXELS = 8  # of a triangle's ten that fail together
# Change beyond that of the other taxels from one cycle to the next, and number of such leaps: a loose contact.
LEAST_LEAP_COUNT, LEAPS = 45.0, 2
FALSE_ALARM_PROBABILITY = 1e-3  # that one of all taxels has more leaps, if all leap alike
LEAST_RATIO = 4.0  # of a leap to the change of the triangle's other taxels
LEAST_NOISE_RATIO, NOISE_WINDOW_S = 8.0, 1.0  # of a leap to the largest mean change of its triangle in a window
LOAD_WINDOW_S, LEAST_LOAD_MOVE = 0.2, 0.02  # before and after a leap; share of the insole's range: the load moves


def silent(
    counts: Array, valid: NDArray[np.bool_], t_s: Array, mean: Array, triangle: NDArray[np.intp], steps: bool
) -> NDArray[np.bool_]:
    """Return which readings (n, m) are invalid, or part of a constant stretch while the load, `mean` (n,), changed.

    Constant readings at an end of the range are left out if the load explains them. With `steps`, the load of a taxel
    may be another than the mean, but it is about that of its `triangle` (m,).
    """
    dead = ~valid
    for i in range(counts.shape[1]):
        change = np.flatnonzero(np.diff(counts[:, i]) != 0)
        starts, ends = np.append(0, change + 1), np.append(change, len(t_s) - 1)
        for first, last in zip(
            starts[t_s[ends] - t_s[starts] > CONSTANT_S], ends[t_s[ends] - t_s[starts] > CONSTANT_S], strict=True
        ):
            if np.ptp(mean[first : last + 1]) > LEAST_LOAD_CHANGE:
                dead[first : last + 1, i] = True
        if not dead[:, i].any():
            continue
        of_triangle = triangle == triangle[i]
        of_triangle[i] = False
        bears_load = np.zeros(len(counts), bool)
        if steps and of_triangle.any():
            bears_load = _bears_load(counts[:, i], counts[:, of_triangle].mean(axis=1), dead[:, i])
        dead[_is_out_of_range(counts[:, i], mean, steps) & ~bears_load, i] = False
    return dead


def _bears_load(count: Array, others: Array, dead: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cycles (n,) of stretches of `dead` in which a taxel bears load, by the other taxels of its triangle.

    `others` (n,) is their mean. Only if the taxel reads less than 255 without load: otherwise its baseline may hide a
    load.
    """
    bears_load = np.zeros(len(count), bool)
    working = ~dead & (count > 0)
    if not working.any() or float(np.quantile(count[working], HIGHEST)) > MOST_AT_REST:
        return bears_load
    slope = float(np.cov(count[working], others[working])[0, 1]) / max(float(np.var(others[working])), 1e-9)
    at_rest = float(np.quantile(others, HIGHEST))
    for first, last in stretches(dead):
        change = at_rest - float(np.quantile(others[first : last + 1], 1.0 - HIGHEST))
        bears_load[first : last + 1] = slope * change > LEAST_BORNE_COUNT
    return bears_load


def _is_out_of_range(count: Array, mean: Array, steps: bool) -> NDArray[np.bool_]:
    """Return the cycles (n,) in which a taxel is at an end of its range because of its load or its baseline.

    Its readings reach and leave the end in small steps, whereas those of a broken line leap. It is at 0 while the load,
    `mean` (n,) as a share of its range, is high, and at 255 while it is low. Without `steps`, it is not at 255 under
    the highest loads.
    """
    high_load = np.inf if steps else float(np.quantile(mean, HIGH_LOAD))
    out_of_range = np.zeros(len(count), bool)
    for end, sign in ((0, 1), (255, -1)):
        at_end = np.zeros(len(count), bool)
        for first, last in stretches(count == end):
            sides = [count[row] for row in (first - 1, last + 1) if 0 <= row < len(count)]
            is_unloaded = end == 0 or float(np.quantile(mean[first : last + 1], STRETCH_LOAD)) < high_load
            at_end[first : last + 1] = (
                bool(sides) and is_unloaded and all(abs(side - end) <= LEAST_LEAP_COUNT for side in sides)
            )
        if at_end.any() and not at_end.all() and sign * (np.median(mean[at_end]) - np.median(mean[~at_end])) > 0:
            out_of_range |= at_end
    return out_of_range


def loose(
    counts: Array, valid: NDArray[np.bool_], mean: Array, t_s: Array, triangle: NDArray[np.intp], steps: bool
) -> NDArray[np.bool_]:
    """Return the taxels (m,) with a loose contact: they leap alone, repeatedly, and half of the time not with the load.

    A snap leaps, too, but down in counts while loading and up while unloading. At a heel strike some taxels leap and
    others do not, but these bear the load for a while: with `steps`, only leaps that reverse in the next cycle count,
    and only if they are much larger than those of the taxel's `triangle` (m,). Glitches make any taxel leap once; a
    loose contact leaps more often than one of m equal taxels does with FALSE_ALARM_PROBABILITY (Poisson).
    """
    change = np.diff(counts, axis=0)
    change -= np.median(change, axis=1, keepdims=True)
    leaps = (np.abs(change) > LEAST_LEAP_COUNT) & valid[1:] & valid[:-1]
    period_s = float(np.median(np.diff(t_s)))
    for row in np.unique(triangle):
        of_triangle = triangle == row
        median_change = np.median(np.abs(change[:, of_triangle]), axis=1)
        largest_noise = float(uniform_filter1d(median_change, max(round(NOISE_WINDOW_S / period_s), 1)).max())
        leaps[:, of_triangle] &= np.abs(change[:, of_triangle]) > LEAST_NOISE_RATIO * largest_noise
    if steps:
        leaps[1:] &= leaps[:-1] & (change[1:] * change[:-1] < 0)
        leaps[0] = False
        for row in np.unique(triangle):
            of_triangle = triangle == row
            leaps[:, of_triangle] &= np.abs(change[:, of_triangle]) > LEAST_RATIO * np.median(
                np.abs(change[:, of_triangle]), axis=1, keepdims=True
            )
    window = max(round(LOAD_WINDOW_S / period_s), 1)
    rows = np.arange(len(change))
    load_change = mean[np.minimum(rows + 1 + window, len(mean) - 1)] - mean[np.maximum(rows - window, 0)]
    with_load = leaps & (change * load_change[:, None] < 0) & (np.abs(load_change) > LEAST_LOAD_MOVE)[:, None]
    number = leaps.sum(axis=0)
    events = number / (1 if steps else 2)  # away, and back
    is_often = (number >= LEAPS) & (events > _most_by_chance(events))
    return np.asarray(is_often & (2 * with_load.sum(axis=0) <= number))


def _most_by_chance(events: Array) -> float:
    """Return the largest number of events that one of m equal taxels has by chance, by the Poisson distribution.

    Its mean is estimated from the share without events and the median, which few taxels with many events hardly change.
    """
    without = max(float(np.mean(events == 0)), 1.0 / len(events))
    usual = max(-np.log(without), float(np.median(events)))
    return float(poisson.isf(FALSE_ALARM_PROBABILITY / len(events), usual))


def at_both_ends(counts: NDArray[Any]) -> NDArray[np.bool_]:
    """Return the cycles (n, n_triangles) in which all pressure taxels of a triangle read 0 or 255, and both occur.

    `counts` (n, n_triangles, 12). No load does that, but a board with an open line, which is pulled up.
    """
    low, high = counts[..., PRESSURE_TAXELS] == 0, counts[..., PRESSURE_TAXELS] == 255
    return np.asarray((low | high).all(axis=2) & low.any(axis=2) & high.any(axis=2))


def opened(open_now: NDArray[np.bool_], at_ends: NDArray[np.bool_], t_s: Array) -> list[int]:
    """Return the rows of triangles that lost contact.

    Most of their taxels are `open_now` (n, n_triangles, 12) for OPEN_S without interruption, or they are `at_ends` (n,
    n_triangles) for OPEN_S in total: a line may open briefly at every step.
    """
    together = open_now.sum(axis=2) >= OPEN_TAXELS
    cycle_s = float(np.median(np.diff(t_s)))
    return [
        row for row in range(together.shape[1])
        if any(t_s[b] - t_s[a] >= OPEN_S for a, b in stretches(together[:, row]))
        or at_ends[:, row].sum() * cycle_s >= OPEN_S
    ]  # fmt: skip


def stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last row of every run of set `flags` (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def intervals(flags: NDArray[np.bool_], t_s: Array) -> Times:
    """Return begin and end, s, of every run of set `flags` (n,)."""
    return tuple((float(t_s[a]), float(t_s[b])) for a, b in stretches(flags))


def joined(when: Sequence[tuple[float, float]], gap_s: float) -> Times:
    """Return the intervals `when`, those closer than `gap_s` joined."""
    intervals_joined: list[tuple[float, float]] = []
    for a, b in when:
        if intervals_joined and a - intervals_joined[-1][1] < gap_s:
            intervals_joined[-1] = (intervals_joined[-1][0], b)
        else:
            intervals_joined.append((a, b))
    return tuple(intervals_joined)
