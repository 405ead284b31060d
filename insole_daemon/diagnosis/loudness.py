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
LITTLE = 0.3  # of the time: under the least load, and under the most

Times = tuple[tuple[float, float], ...]

# E|z| of a normal variable without its largest fifth: (φ(0) − φ(1.2816)) · 2 / 0.8.
_MEAN_OF_FOUR_FIFTHS = 0.5586


def loud_boards(
    counts: Array, believed: NDArray[np.bool_], boards: NDArray[np.uint8], t_s: Array
) -> list[tuple[NDArray[np.bool_], Times]]:
    """(m,) taxels of each board that is loud for more than MOST_LOUD of the time, and when.

    `counts`, `believed` (n, m), `boards` (m,). Windows with readings that are not believed say nothing: where they
    stand at an end of their range, or come again, there is no noise.
    """
    level, window = _levels(counts, t_s)
    level[_any(~believed, window)] = np.nan
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
    level, window = _levels(counts, t_s)
    loud = level > LOUD * noise_of_readings(counts, believed)
    loud &= ~_any(~believed, window)  # what is lost makes steps of its own
    # A step of the load is one loud window of all taxels; a burst lasts, or is some taxels' own.
    for_long = loud.sum(axis=0) * window * float(np.median(np.diff(t_s))) >= BURST_S
    if not for_long.any():
        return taxels, flags, ()
    there = (loud[:, for_long].sum(axis=1) >= max(1, 0.5 * for_long.sum())).astype(float)
    # A burst begins and ends within a window.
    times = np.repeat(np.convolve(there, np.ones(3), mode="same") > 0, window)
    flags[: len(times)] = times
    if flags.mean() > 0.5:
        return taxels, np.zeros(len(t_s), bool), ()
    return for_long, flags, joined(intervals(flags, t_s), WINDOW_S)


def louder(counts: Array, believed: NDArray[np.bool_], t_s: Array, load: Array) -> float:
    """How many times as noisy the typical taxel is under much load as under little; `load` (n,). 1 where none can say.

    `counts`, `believed` (n, m).
    """
    level, window = _levels(counts, t_s)
    if len(level) < LEAST_WINDOWS:
        return 1.0
    level[_any(~believed, window)] = np.nan
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


def _levels(counts: Array, t_s: Array) -> tuple[Array, int]:
    """(windows, m) noise of each taxel in each WINDOW_S, and how many cycles that is."""
    window = max(round(WINDOW_S / float(np.median(np.diff(t_s)))), 4)
    n = len(t_s) // window
    third = np.abs(np.diff(counts, n=3, axis=0, prepend=counts[:3])) / np.sqrt(20.0)
    # Without the largest fifth: a snap is in a few differences of a window, noise is in all of them.
    sizes = np.sort(third[: n * window].reshape(n, window, -1), axis=1)[:, : round(0.8 * window)]
    return sizes.mean(axis=1) / _MEAN_OF_FOUR_FIFTHS, window


def _any(flags: NDArray[np.bool_], window: int) -> NDArray[np.bool_]:
    """(windows, m) whether any of (n, m) is set in each window."""
    n = len(flags) // window
    return np.asarray(flags[: n * window].reshape(n, window, -1).any(axis=1))
