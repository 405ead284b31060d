"""Taxels and triangles without a contact: what says one number for ever, leaps, or fails all together."""

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

SAME_S = 4.0  # a working taxel does not say one number for so long while the load moves
MOVED = 0.15  # of the insole's range: the load moved
OPEN_S = 0.3  # how long a triangle is silent before it is called open
OPEN_TAXELS = 8  # of a triangle's ten that fail together: the triangle has lost contact
# Further than the other taxels from one cycle to the next, and how often: a loose contact.
LEAP_COUNT, LEAPS = 45.0, 2
LEAPS_BY_CHANCE = 1e-3  # of a taxel of the insole, more leaps than if all leapt alike
ALONE = 4.0  # times the change of a triangle's other taxels: they have no part in it
SCATTER, SCATTER_S = 8.0, 1.0  # times what its triangle's taxels change by at their loudest: no leap but noise
MOVES_S, MOVES = 0.2, 0.02  # before and after a leap, by what part of the insole's range the load moves


def silent(counts: Array, valid: NDArray[np.bool_], t_s: Array, mean: Array) -> NDArray[np.bool_]:
    """(n, m) not to be believed, or one number for long while the load moved, and not for the load's sake."""
    dead = ~valid
    for i in range(counts.shape[1]):
        change = np.flatnonzero(np.diff(counts[:, i]) != 0)
        starts, ends = np.append(0, change + 1), np.append(change, len(t_s) - 1)
        for a, b in zip(starts[t_s[ends] - t_s[starts] > SAME_S], ends[t_s[ends] - t_s[starts] > SAME_S], strict=True):
            if np.ptp(mean[a : b + 1]) > MOVED:
                dead[a : b + 1, i] = True
        dead[_beyond(counts[:, i], mean), i] = False
    return dead


def _beyond(count: Array, mean: Array) -> NDArray[np.bool_]:
    """(n,) cycles in which a taxel stands at an end of its range because the load, or its rest count, is beyond it.

    It comes there and leaves step by step, where a line that breaks gets there in one leap, and is at 0 while the
    insole bears more than else, `mean` (n,) of its range, and at 255 while it bears less.
    """
    found = np.zeros(len(count), bool)
    for end, sign in ((0, 1), (255, -1)):
        there = np.zeros(len(count), bool)
        for a, b in stretches(count == end):
            sides = [count[row] for row in (a - 1, b + 1) if 0 <= row < len(count)]
            there[a : b + 1] = bool(sides) and all(abs(side - end) <= LEAP_COUNT for side in sides)
        if there.any() and not there.all() and sign * (np.median(mean[there]) - np.median(mean[~there])) > 0:
            found |= there
    return found


def loose(
    counts: Array, valid: NDArray[np.bool_], mean: Array, t_s: Array, triangle: NDArray[np.intp], steps: bool
) -> NDArray[np.bool_]:
    """(m,) taxels that leapt alone from one cycle to the next, several times, and half of the time not with the load.

    What snaps leaps as well, but down in counts while it is loaded, and up while it is unloaded. Where a heel strikes,
    some taxels leap and the others do not; but then they bear that load for a while: of `steps` only what leaps back at
    once counts. Where readings are seldom a blow lasts no longer than one of them, but the taxels around feel it: what
    leaps counts only if it leaps much further than those of its `triangle` (m,) do. Glitches make any taxel leap for a
    reading: a loose contact leaps more often than chance lets one of all taxels do that leap alike.
    """
    change = np.diff(counts, axis=0)
    change -= np.median(change, axis=1, keepdims=True)
    leaps = (np.abs(change) > LEAP_COUNT) & valid[1:] & valid[:-1]
    period_s = float(np.median(np.diff(t_s)))
    for row in np.unique(triangle):
        own = triangle == row
        course = np.median(np.abs(change[:, own]), axis=1)
        loudest = float(uniform_filter1d(course, max(round(SCATTER_S / period_s), 1)).max())
        leaps[:, own] &= np.abs(change[:, own]) > SCATTER * loudest
    if steps:
        leaps[1:] &= leaps[:-1] & (change[1:] * change[:-1] < 0)
        leaps[0] = False
        for row in np.unique(triangle):
            own = triangle == row
            leaps[:, own] &= np.abs(change[:, own]) > ALONE * np.median(np.abs(change[:, own]), axis=1, keepdims=True)
    side = max(round(MOVES_S / period_s), 1)
    rows = np.arange(len(change))
    went = mean[np.minimum(rows + 1 + side, len(mean) - 1)] - mean[np.maximum(rows - side, 0)]
    along = leaps & (change * went[:, None] < 0) & (np.abs(went) > MOVES)[:, None]
    number = leaps.sum(axis=0)
    events = number / (1 if steps else 2)  # away, and back
    is_often = (number >= LEAPS) & (events > _most_by_chance(events))
    return np.asarray(is_often & (2 * along.sum(axis=0) <= number))


def _most_by_chance(events: Array) -> float:
    """Most events of one of m taxels, if all have them alike; a few that have many hardly change what most have."""
    without = max(float(np.mean(events == 0)), 1.0 / len(events))
    usual = max(-np.log(without), float(np.median(events)))
    return float(poisson.isf(LEAPS_BY_CHANCE / len(events), usual))


def at_both_ends(counts: NDArray[Any]) -> NDArray[np.bool_]:
    """(n, n_triangles) cycles in which all pressure taxels of `counts` (n, n_triangles, 12) read 0 or 255, some each.

    No load does that: a board that lost its triangle reads so, because the open line is pulled up.
    """
    low, high = counts[..., PRESSURE_TAXELS] == 0, counts[..., PRESSURE_TAXELS] == 255
    return np.asarray((low | high).all(axis=2) & low.any(axis=2) & high.any(axis=2))


def opened(open_now: NDArray[np.bool_], at_ends: NDArray[np.bool_], t_s: Array) -> list[int]:
    """Rows of triangles that lost contact.

    Most of their taxels `open_now` (n, n_triangles, 12) say nothing for OPEN_S at a stretch, or they are `at_ends`
    (n, n_triangles) for as long in all: a line may open with every step, for a shorter time than that.
    """
    together = open_now.sum(axis=2) >= OPEN_TAXELS
    least_cycles = OPEN_S / float(np.median(np.diff(t_s)))
    return [
        row for row in range(together.shape[1])
        if any(t_s[b] - t_s[a] >= OPEN_S for a, b in stretches(together[:, row]))
        or at_ends[:, row].sum() >= least_cycles
    ]  # fmt: skip


def stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last row of every run of set `flags` (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def intervals(flags: NDArray[np.bool_], t_s: Array) -> Times:
    """From when to when `flags` (n,) are set."""
    return tuple((float(t_s[a]), float(t_s[b])) for a, b in stretches(flags))


def joined(when: Sequence[tuple[float, float]], gap_s: float) -> Times:
    """Intervals closer than `gap_s` as one."""
    found: list[tuple[float, float]] = []
    for a, b in when:
        if found and a - found[-1][1] < gap_s:
            found[-1] = (found[-1][0], b)
        else:
            found.append((a, b))
    return tuple(found)
