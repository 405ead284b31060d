"""Stretches in which taxels, or whole boards, are far noisier than usual."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..physics.law import Array
from .floor import LEAST_COUNT, noise_of_readings
from .observed import stretches

LOUD = 2.5  # times its usual noise: a burst
BOARD_LOUD = 2.0  # times its quietest tenth, of a board's typical taxel: the board has another state
MOST_LOUD = 0.1  # of the time: a board that is loud for longer is left out
BURST_S = 0.3
WINDOW_S = 1.0
LEAST_WINDOWS = 20
TOGETHER = 8  # taxels that are loud in the same recording: fewer have to be louder, by what few readings scatter
MANY = 50  # readings in a window, of which LOUD is no chance
COMPLETE = 0.9  # of the readings that the taxel's usual window has: fewer, and some were lost or out of range
QUIET, STEEP = 0.25, 0.8  # quantiles of a taxel's windows: the noise at rest, and the slopes that show a jitter
LEAST_NEW = 0.1  # of the cycles of a window with readings that are believed: from fewer no noise is told
LITTLE = 0.3  # of the time: under the least load, and under the most

Times = tuple[tuple[float, float], ...]

# E|z| of a normal variable without its largest fifth: (φ(0) − φ(1.2816)) · 2 / 0.8.
_MEAN_OF_FOUR_FIFTHS = 0.5586


def loud_boards(
    counts: Array, believed: NDArray[np.bool_], boards: NDArray[np.uint8], t_s: Array
) -> list[tuple[NDArray[np.bool_], Times]]:
    """(m,) taxels of each board that is loud for more than MOST_LOUD of the time, and when.

    `counts`, `believed` (n, m), `boards` (m,). Readings that stand at an end of their range, or come again, have no
    noise and are not asked.
    """
    level, window = _levels(counts, believed, t_s)
    known = np.isfinite(level).mean(axis=0) > MOST_LOUD
    if len(level) < LEAST_WINDOWS or not known.any():
        return []
    found = []
    quiet = np.maximum(np.nanquantile(level[:, known], 0.1, axis=0), LEAST_COUNT)
    ratio = np.nan_to_num(level[:, known] / quiet, nan=1.0)
    for board in np.unique(boards):
        own = boards[known] == board
        loud = np.asarray(np.median(ratio[:, own], axis=1) > BOARD_LOUD) if own.any() else np.zeros(len(level), bool)
        if loud.mean() > MOST_LOUD:
            found.append((boards == board, joined(intervals(loud, t_s[::window]), 2 * WINDOW_S)))
    return found if len(found) < len(np.unique(boards)) else []  # all of them: it is the load's doing


def bursts(
    counts: Array, believed: NDArray[np.bool_], t_s: Array
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], Times]:
    """(m,) taxels that are loud together for a while, (n,) the cycles, and when; none: nothing is set."""
    taxels, flags = np.zeros(counts.shape[1], bool), np.zeros(len(t_s), bool)
    if not taxels.size or len(t_s) < 100:
        return taxels, flags, ()
    level, window = _levels(counts, believed, t_s)
    ratio = level / noise_of_readings(_own(counts, believed), believed)
    loud, for_long = _loud(ratio, LOUD, window, t_s)
    if for_long.sum() < TOGETHER:  # one of hundreds of taxels, in one of hundreds of windows, is chance
        loud, for_long = _loud(ratio, 1.0 + (LOUD - 1.0) * np.sqrt(max(MANY / window, 1.0)), window, t_s)
    if not for_long.any():
        return taxels, flags, ()
    there = (loud[:, for_long].sum(axis=1) >= max(1, 0.5 * for_long.sum())).astype(float)
    # A burst begins and ends within a window.
    times = np.repeat(np.convolve(there, np.ones(3), mode="same") > 0, window)
    flags[: len(times)] = times
    if flags.mean() > 0.5:
        return taxels, np.zeros(len(t_s), bool), ()
    return for_long, flags, joined(intervals(flags, t_s), WINDOW_S)


def _loud(ratio: Array, most: float, window: int, t_s: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(windows, m) whose noise is more than `most` times the usual, and (m,) the taxels that are so for long."""
    loud = ratio > most
    # A step of the load is one loud window of all taxels; a burst lasts, or is some taxels' own.
    for_long: NDArray[np.bool_] = loud.sum(axis=0) * window * float(np.median(np.diff(t_s))) >= BURST_S
    return loud, for_long


def louder(counts: Array, believed: NDArray[np.bool_], t_s: Array, load: Array) -> float:
    """How many times as noisy the typical taxel is under much load as under little; `load` (n,). 1 where none can say.

    `counts`, `believed` (n, m).
    """
    level, window = _levels(counts, believed, t_s)
    if len(level) < LEAST_WINDOWS:
        return 1.0
    bore = load[: len(level) * window].reshape(len(level), window).mean(axis=1)
    little, much = level[bore <= np.quantile(bore, LITTLE)], level[bore >= np.quantile(bore, 1.0 - LITTLE)]
    known = np.all([np.isfinite(each).mean(axis=0) > MOST_LOUD for each in (little, much)], axis=0)
    if not known.any():
        return 1.0
    below, above = (np.maximum(np.nanmedian(each[:, known], axis=0), LEAST_COUNT) for each in (little, much))
    return float(np.median(above / below))


def intervals(flags: NDArray[np.bool_], t_s: Array) -> Times:
    """From when to when `flags` (n,) are set."""
    return tuple((float(t_s[a]), float(t_s[b])) for a, b in stretches(flags))


def joined(when: Times, gap_s: float) -> Times:
    """Intervals closer than `gap_s` as one."""
    found: list[tuple[float, float]] = []
    for a, b in when:
        if found and a - found[-1][1] < gap_s:
            found[-1] = (found[-1][0], b)
        else:
            found.append((a, b))
    return tuple(found)


def _levels(counts: Array, believed: NDArray[np.bool_], t_s: Array) -> tuple[Array, int]:
    """(windows, m) noise of each taxel's believed readings in each WINDOW_S, and how many cycles that is.

    Of what no cubic of the median reading explains: the edges of a load that is sampled seldom are no noise. NaN where
    there are too few readings.
    """
    own = _own(counts, believed)
    window = max(round(WINDOW_S / float(np.median(np.diff(t_s)))), 4)
    n = len(t_s) // window
    third = np.full(own.shape, np.nan)
    for column in range(own.shape[1]):
        rows = np.flatnonzero(believed[:, column])
        third[rows[3:], column] = np.abs(np.diff(own[rows, column], n=3)) / np.sqrt(20.0)
    # Without the largest fifth: a snap is in a few differences of a window, noise is in all of them.
    sizes = np.sort(third[: n * window].reshape(n, window, -1), axis=1)  # NaN last
    known = np.isfinite(sizes).sum(axis=1)
    asked = np.rint(0.8 * known).astype(np.intp)
    rank = np.arange(window)[:, None]
    total = np.sum(np.where(rank < asked[:, None], np.nan_to_num(sizes), 0.0), axis=1)
    # Where some are missing that others have, steps and ends of the range pass for noise.
    enough = (known >= LEAST_NEW * window) & (known >= COMPLETE * np.median(known, axis=0))
    level = np.where(enough, total / np.maximum(asked, 1), np.nan) / _MEAN_OF_FOUR_FIFTHS
    slope = np.gradient(counts - own, axis=0)[: n * window].reshape(n, window, -1)
    return _without_jitter(level, np.mean(slope**2, axis=1)), window


def _without_jitter(level: Array, slope2: Array) -> Array:
    """(windows, m) levels without what the reading times add: their jitter times the slope of the load.

    `slope2` (windows, m) mean squares of the slope. The jitter is what the typical taxel has more in its steep windows:
    a converter that runs beside the clock of its board is up to one of its rounds late, differently every time.
    """
    known = np.isfinite(level).any(axis=0)
    if not known.any():
        return level
    usual = np.full(level.shape[1], np.nan)
    usual[known] = np.nanquantile(level[:, known], QUIET, axis=0)
    steep = slope2 > np.quantile(slope2, STEEP, axis=0)
    more = (level**2 - usual**2)[steep & np.isfinite(level) & (slope2 > 0)]
    jitter2 = max(float(np.median(more / slope2[steep & np.isfinite(level) & (slope2 > 0)])), 0.0) if more.size else 0.0
    found: Array = level / np.sqrt(1.0 + jitter2 * slope2 / np.maximum(usual, LEAST_COUNT) ** 2)
    return found


def _own(counts: Array, believed: NDArray[np.bool_]) -> Array:
    """(n, m) the readings less what all of them share, a cubic of their median, fitted to those `believed` of each."""
    middle = np.median(counts, axis=1)
    x = (middle - middle.mean()) / max(float(np.ptp(middle)), 1e-9)
    shared = np.stack([np.ones_like(x), x, x**2, x**3], axis=1)
    basis = np.linalg.qr(shared)[0]
    own: Array = counts - basis @ (basis.T @ counts)
    for column in np.flatnonzero(~believed.all(axis=0)):
        good = believed[:, column] if believed[:, column].sum() > shared.shape[1] else slice(None)
        fitted = np.linalg.lstsq(shared[good], counts[good, column], rcond=None)[0]
        own[:, column] = counts[:, column] - shared @ fitted
    return own
