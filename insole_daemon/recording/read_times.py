"""When the triangles of a recording were read: how often, which readings are new, and which were due and lost.

Cycles repeat what a slow board said last, and a board repeats what its converter said last. Both look like readings and
are none: they say nothing new, and the noise between them is zero.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..skin.cycles import TWICE_NS

OVERDUE = 1.5  # intervals without a reading: one was lost; jitter is far less
SURE = 0.9  # probability that bytes which repeat are of one conversion, and no chance
RARE = 1e-4  # probability of so many equal readings in a row
MOST_EQUAL = 5  # in a row, of a triangle that never changes: it has nothing to measure chance by
CHUNK = 50  # readings that differ from the one before, over which chance is measured
FIXED_POINT_STEPS = 30

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Times = NDArray[np.int64]


def median_interval_ns(t_ns: Times) -> float:
    """Median time between readings at `t_ns` (n,), each counted once however often it came; NaN of fewer than three."""
    apart = np.diff(t_ns)
    apart = apart[apart >= TWICE_NS]
    return float(np.median(apart)) if apart.size > 1 else float("nan")


def arrived(read_ns: Times) -> Flags:
    """(n, n_triangles) cycles that brought a reading, by the times (n, n_triangles) of their readings; -1: never."""
    found = np.zeros(read_ns.shape, np.bool_)
    if len(read_ns):
        found[0] = read_ns[0] >= 0
        found[1:] = (np.diff(read_ns, axis=0) >= TWICE_NS) & (read_ns[1:] >= 0)
    return found


def overdue(came: Flags, read_ns: Times, closed_ns: Times, late_ns: Array | None = None) -> Flags:
    """(n, n_triangles) cycles in which a reading was due and had not come, at the interval of each triangle.

    `came` (n, n_triangles) cycles that brought a reading, of `read_ns` (n, n_triangles); `closed_ns` (n,). `late_ns`
    (n_triangles,) may each come later than its interval. A triangle that fell silent is overdue until the end.
    """
    late_ns = np.zeros(came.shape[1]) if late_ns is None else late_ns
    found = np.zeros(came.shape, np.bool_)
    for column in np.flatnonzero(came.any(axis=0)):
        times = read_ns[came[:, column], column]
        interval_ns = median_interval_ns(times)
        if not interval_ns > 0:
            continue
        if closed_ns[-1] - times[-1] > (1.0 + OVERDUE) * interval_ns:  # else the end came between two readings
            times = np.append(times, closed_ns[-1])
        for at in np.flatnonzero(np.diff(times) > OVERDUE * interval_ns + late_ns[column]):
            lost = round(float(times[at + 1] - times[at]) / interval_ns) - 1
            due_ns = times[at] + np.arange(1, lost + 1) * interval_ns
            found[np.minimum(np.searchsorted(closed_ns, due_ns), len(found) - 1), column] = True
    return found & ~came


def held(counts: NDArray[np.uint8]) -> Flags:
    """(n,) readings of a triangle, (n, 12) counts, that repeat the conversion before them.

    A reading that equals the one before is a repetition unless chance makes as many: chance is the product of how often
    each taxel says the same twice, among readings that differ somewhere, since the equal ones may be repetitions.
    """
    if len(counts) < 2:
        return np.zeros(len(counts), np.bool_)
    equal = counts[1:] == counts[:-1]
    # What stands at an end of its range, as all of a triangle without contact does, repeats itself.
    within = ((counts > 0) & (counts < 255)).sum(axis=1) >= counts.shape[1] / 2
    same: Flags = np.concatenate([[False], equal.all(axis=1)]) & within
    differs = np.flatnonzero(~same)[1:]
    if not same.any():
        return same
    run = _run_lengths(same)
    if len(differs) < CHUNK // 2:
        return same & (run >= MOST_EQUAL)
    parts = np.array_split(differs, max(len(differs) // CHUNK, 1))
    chance = np.array([_all_equal(equal[part - 1].mean(axis=0)) for part in parts])
    chance = np.maximum(chance, np.median(chance))
    of_row = chance[np.clip(np.searchsorted([part[0] for part in parts], np.arange(len(same)), "right") - 1, 0, None)]
    repeats = max(float(same.mean() - of_row.mean()), 0.0)
    found: Flags = same & ((repeats >= SURE * (repeats + of_row)) & (repeats > 0) | (of_row**run < RARE))
    return found


def new_readings(came: Flags, counts: NDArray[np.uint8]) -> Flags:
    """(n, n_triangles) cycles that brought a reading, `came`, of a conversion that none before had."""
    found = came.copy()
    for column in range(came.shape[1]):
        rows = np.flatnonzero(came[:, column])
        found[rows[held(counts[rows, column])], column] = False
    return found


def at_cycles(counts: NDArray[np.uint8], is_new: Flags, cycle_s: Array, behind_s: Array) -> Array:
    """(n, m) counts at the moments of the cycles, on straight lines between readings that are new.

    `behind_s` (n, m): how long before `cycle_s` (n,) each of `counts` (n, m) was read. A taxel without any new reading
    stays as it is.
    """
    found = counts.astype(np.float64)
    for column in np.flatnonzero((behind_s.any(axis=0) | ~is_new.all(axis=0)) & is_new.any(axis=0)):
        new = is_new[:, column]
        found[:, column] = np.interp(cycle_s, (cycle_s - behind_s[:, column])[new], found[new, column])
    return found


def _all_equal(equal: Array) -> float:
    """Probability that all taxels say the same twice, of how often each does among readings that differ somewhere.

    Of independent taxels, p = q·(1 − Π) + Π and Π = ∏ p, for readings that all agree are not among those counted.
    """
    together = 0.0
    for _ in range(FIXED_POINT_STEPS):
        together = float(np.prod(equal * (1.0 - together) + together))
    return together


def _run_lengths(flags: Flags) -> NDArray[np.int64]:
    """(n,) of set `flags`, how many stand in a row around each; 0 where not set."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    found = np.zeros(len(flags), np.int64)
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        found[first:end] = end - first
    return found
