"""Initial contact and toe-off of every stance of a recorded foot, interpolated between cycles.

A foot is loaded from the moment f_z exceeds a high level until it falls below a low one. Both levels are above the
rest level: insoles keep an offset and drift. The low level is 20 N, as is customary with force plates (Tirosh & Sparrow
2003, J. Appl. Biomech. 19:158), or a twentieth of the usual largest force, since a sensor with memory forgets a step
only slowly.

Contact is where a line through the first sample above the high level meets the rest level, as steep as the force is
there; toe-off is the same with the last one. Both lie between samples, so that 50 Hz resolves a few milliseconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LOW_N, LOW_FRACTION = 20.0, 0.05
HIGH_N, HIGH_FRACTION = 60.0, 0.15
LONGEST_GAP_S = 0.2  # between cycles; a stance with a longer one in it is not used
SHORTEST_STANCE_S = 0.1
SHORTEST_SWING_S = 0.1  # a shorter one is a dip within a stance
_BLOCK_S = 1.0
_BLOCKS_AROUND = 3
_UNLOADED_FRACTION = 0.2  # of the largest force around: what is above it is no rest
_USUAL_LARGEST_PERCENT = 95.0


@dataclass(frozen=True, slots=True, eq=False)
class Contacts:
    """The n stances of one foot, in order; `first` and `last` are the samples whose force is above the low level."""

    contact_s: NDArray[np.float64]  # (n,) NaN: the recording begins within this stance
    toe_off_s: NDArray[np.float64]  # (n,) NaN: it ends within it
    contact_std_s: NDArray[np.float64]  # (n,) of the wrench's uncertainty; NaN: not known
    toe_off_std_s: NDArray[np.float64]
    first: NDArray[np.intp]  # (n,)
    last: NDArray[np.intp]  # (n,)

    def __len__(self) -> int:
        """Return the number of stances."""
        return len(self.first)


def find_contacts(
    t_s: NDArray[np.float64],
    f_z_n: NDArray[np.float64],
    f_z_std_n: NDArray[np.float64] | None = None,
    rest_n: NDArray[np.float64] | None = None,
) -> Contacts:
    """Return the stances in `f_z_n` (n,) at `t_s` (n,), which increases.

    `f_z_std_n` (n,): standard deviation, NaN: not known. `rest_n` (n,): the rest level; without it, `rest_level`.
    """
    std_n = np.full_like(f_z_n, np.nan) if f_z_std_n is None else f_z_std_n
    known = np.flatnonzero(np.isfinite(f_z_n))
    times, force = t_s[known], f_z_n[known]
    rest = rest_level(times, force) if rest_n is None else rest_n[known]
    if rest is None:
        return _as_contacts([])
    above_n = float(np.percentile(force - rest, _USUAL_LARGEST_PERCENT))
    low = rest + max(LOW_N, LOW_FRACTION * above_n)
    high = rest + max(HIGH_N, HIGH_FRACTION * above_n)
    rows = []
    for first, last in _loaded_runs(times, force, low, high):
        if np.any(np.diff(times[first : last + 1]) > LONGEST_GAP_S):
            continue
        if times[last] - times[first] < SHORTEST_STANCE_S:
            continue
        risen = first + np.flatnonzero(force[first : last + 1] >= high[first : last + 1])
        contact_s, contact_slope = _meets_rest(times, force, rest, int(risen[0]), 1, first)
        toe_off_s, toe_off_slope = _meets_rest(times, force, rest, int(risen[-1]), -1, last)
        rows.append((
            contact_s, toe_off_s, std_n[known[first]] / contact_slope, std_n[known[last]] / toe_off_slope,
            known[first], known[last],
        ))  # fmt: skip
    return _as_contacts(rows)


def rest_level(t_s: NDArray[np.float64], f_z_n: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the force of the unloaded foot at `t_s`, (n,); None where the foot is never both loaded and unloaded."""
    if len(t_s) < 2:
        return None
    block = ((t_s - t_s[0]) / _BLOCK_S).astype(np.intp)
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    least, most = np.minimum.reduceat(f_z_n, starts), np.maximum.reduceat(f_z_n, starts)
    levels, at_s = [], []
    for number, start in enumerate(starts.tolist()):
        around = slice(max(0, number - _BLOCKS_AROUND), number + _BLOCKS_AROUND + 1)
        lowest, highest = float(least[around].min()), float(most[around].max())
        if highest - lowest >= HIGH_N and lowest < _UNLOADED_FRACTION * highest:
            levels.append(lowest)
            at_s.append(float(t_s[start]) + _BLOCK_S / 2)
    return np.interp(t_s, at_s, levels) if levels else None


def _loaded_runs(
    t_s: NDArray[np.float64], f_z_n: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]
) -> list[tuple[int, int]]:
    """Return first and last sample above `low` of every run that reaches `high`; a dip does not end a run."""
    above = np.concatenate([[False], f_z_n >= low, [False]])
    edges = np.flatnonzero(np.diff(above.astype(np.int8)))
    runs: list[tuple[int, int]] = []
    for first, end in edges.reshape(-1, 2).tolist():
        last = end - 1
        if not np.any(f_z_n[first:end] >= high[first:end]):
            continue
        if runs and t_s[first] - t_s[runs[-1][1]] < SHORTEST_SWING_S:
            runs[-1] = (runs[-1][0], last)
        else:
            runs.append((first, last))
    return runs


def _meets_rest(
    t_s: NDArray[np.float64],
    f_z_n: NDArray[np.float64],
    rest: NDArray[np.float64],
    risen: int,
    inward: int,
    edge: int,
) -> tuple[float, float]:
    """Return when in s a line through the sample `risen` meets the rest level, and its slope in N/s.

    The slope is the steeper one to a neighbour.

    The moment lies between the sample outside of `edge`, the outermost of the stance, and the sample `risen`. NaN at
    the ends of the recording and beside a gap.
    """
    outside = edge - inward
    if not 0 <= outside < len(t_s) or abs(t_s[outside] - t_s[edge]) > LONGEST_GAP_S:
        return np.nan, np.nan
    beside = [at for at in (risen - 1, risen + 1) if 0 <= at < len(t_s)]
    slope = max(abs(float((f_z_n[at] - f_z_n[risen]) / (t_s[at] - t_s[risen]))) for at in beside)
    reach_s = min(float(f_z_n[risen] - rest[risen]) / slope, abs(float(t_s[outside] - t_s[risen])))
    return float(t_s[risen]) - inward * reach_s, slope


def _as_contacts(rows: Sequence[tuple[float, ...]]) -> Contacts:
    columns = np.array(rows, np.float64).reshape(-1, 6).T
    contact_s, toe_off_s, contact_std_s, toe_off_std_s, first, last = columns
    return Contacts(contact_s, toe_off_s, contact_std_s, toe_off_std_s, first.astype(np.intp), last.astype(np.intp))
