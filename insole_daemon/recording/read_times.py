"""Determine when triangles were read: how often, which readings are new, and which were due and are missing.

A cycle repeats the last reading of a slow board, and a board repeats the last conversion of its converter. Both look
like readings but carry no new information, and the noise between them is zero.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..skin.assembler import TWICE_NS

OVERDUE = 1.5  # intervals without a reading after which one counts as lost; jitter is far smaller
MIN_PROBABILITY = 0.9  # least probability that equal readings are of one conversion
CHANCE_LIMIT = 1e-4  # probability by chance below which a run of equal readings counts as repeated
MAX_EQUAL = 5  # longest accepted run for a triangle with too few changes to estimate the probability
CHUNK = 50  # changed readings over which the probability of equal readings is estimated
FIXED_POINT_STEPS = 30

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Times = NDArray[np.int64]


def median_interval_ns(t_ns: Times) -> float:
    """Return the median time between readings at `t_ns` (n,), repeated times counted once; NaN for fewer than three."""
    intervals_ns = np.diff(t_ns)
    intervals_ns = intervals_ns[intervals_ns >= TWICE_NS]
    return float(np.median(intervals_ns)) if intervals_ns.size > 1 else float("nan")


def arrived(read_ns: Times) -> Flags:
    """Return (n, n_triangles) cycles that brought a reading, from the `read_ns` (n, n_triangles) of each; -1: never."""
    is_arrived = np.zeros(read_ns.shape, np.bool_)
    if len(read_ns):
        is_arrived[0] = read_ns[0] >= 0
        is_arrived[1:] = (np.diff(read_ns, axis=0) >= TWICE_NS) & (read_ns[1:] >= 0)
    return is_arrived


def find_overdue(has_arrived: Flags, read_ns: Times, closed_ns: Times, late_ns: Array | None = None) -> Flags:
    """Return (n, n_triangles) cycles in which a reading was due, by the triangle's median interval, and did not arrive.

    `has_arrived` (n, n_triangles) cycles that brought a reading, `read_ns` (n, n_triangles) their times, `closed_ns`
    (n,) the times at which cycles closed. `late_ns` (n_triangles,) is a tolerance added to the interval. A triangle
    that fell silent is overdue until the end.
    """
    late_ns = np.zeros(has_arrived.shape[1]) if late_ns is None else late_ns
    is_overdue = np.zeros(has_arrived.shape, np.bool_)
    for column in np.flatnonzero(has_arrived.any(axis=0)):
        times = read_ns[has_arrived[:, column], column]
        interval_ns = median_interval_ns(times)
        if not interval_ns > 0:
            continue
        if closed_ns[-1] - times[-1] > (1.0 + OVERDUE) * interval_ns:  # else the recording ended between two readings
            times = np.append(times, closed_ns[-1])
        for gap in np.flatnonzero(np.diff(times) > OVERDUE * interval_ns + late_ns[column]):
            lost = round(float(times[gap + 1] - times[gap]) / interval_ns) - 1
            due_ns = times[gap] + np.arange(1, lost + 1) * interval_ns
            is_overdue[np.minimum(np.searchsorted(closed_ns, due_ns), len(is_overdue) - 1), column] = True
    return is_overdue & ~has_arrived


def find_repeated_conversions(counts: NDArray[np.uint8]) -> Flags:
    """Return (n,) readings of a triangle, `counts` (n, 12), that repeat the previous conversion.

    An equal reading is a repetition unless chance explains it. The probability by chance is the product of each taxel's
    frequency of equal successive values, over readings that differ somewhere, since equal readings may be repetitions.
    """
    if len(counts) < 2:
        return np.zeros(len(counts), np.bool_)
    equal = counts[1:] == counts[:-1]
    # Taxels at an end of the range, such as those of an open triangle, repeat by themselves.
    is_within_range = ((counts > 0) & (counts < 255)).sum(axis=1) >= counts.shape[1] / 2
    same: Flags = np.concatenate([[False], equal.all(axis=1)]) & is_within_range
    differs = np.flatnonzero(~same)[1:]
    if not same.any():
        return same
    run = _run_lengths(same)
    if len(differs) < CHUNK // 2:
        return same & (run >= MAX_EQUAL)
    chunks = np.array_split(differs, max(len(differs) // CHUNK, 1))
    chance = np.array([_all_equal(equal[chunk - 1].mean(axis=0)) for chunk in chunks])
    chance = np.maximum(chance, np.median(chance))
    chance_of_row = chance[
        np.clip(np.searchsorted([chunk[0] for chunk in chunks], np.arange(len(same)), "right") - 1, 0, None)
    ]
    repeats = max(float(same.mean() - chance_of_row.mean()), 0.0)
    is_repeated: Flags = same & (
        (repeats >= MIN_PROBABILITY * (repeats + chance_of_row)) & (repeats > 0) | (chance_of_row**run < CHANCE_LIMIT)
    )
    return is_repeated


def find_new_readings(has_arrived: Flags, counts: NDArray[np.uint8]) -> Flags:
    """Return (n, n_triangles) cycles in `has_arrived` whose reading is of a new conversion."""
    is_new = has_arrived.copy()
    for column in range(has_arrived.shape[1]):
        rows = np.flatnonzero(has_arrived[:, column])
        is_new[rows[find_repeated_conversions(counts[rows, column])], column] = False
    return is_new


def at_cycles(counts: NDArray[np.uint8], is_new: Flags, cycle_s: Array, behind_s: Array) -> Array:
    """Return (n, m) counts at the times of the cycles, interpolated linearly between new readings.

    `behind_s` (n, m) is how long before `cycle_s` (n,) each of `counts` (n, m) was read. A taxel without a new reading
    keeps its counts.
    """
    interpolated = counts.astype(np.float64)
    for column in np.flatnonzero((behind_s.any(axis=0) | ~is_new.all(axis=0)) & is_new.any(axis=0)):
        new = is_new[:, column]
        interpolated[:, column] = np.interp(cycle_s, (cycle_s - behind_s[:, column])[new], interpolated[new, column])
    return interpolated


def _all_equal(equal: Array) -> float:
    """Return the probability that all taxels repeat, from each taxel's frequency among readings that differ somewhere.

    For independent taxels p = q·(1 − Π) + Π with Π = ∏ p, because readings that all agree are not counted in q.
    """
    all_equal = 0.0
    for _ in range(FIXED_POINT_STEPS):
        all_equal = float(np.prod(equal * (1.0 - all_equal) + all_equal))
    return all_equal


def _run_lengths(flags: Flags) -> NDArray[np.int64]:
    """Return (n,) the length of the run around each set flag; 0 where the flag is not set."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    lengths = np.zeros(len(flags), np.int64)
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        lengths[first:end] = end - first
    return lengths
