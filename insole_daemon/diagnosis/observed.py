"""What a diagnosis looks at: the counts of one insole in one recording, and the load that was on it then.

Counts are averaged over short blocks of cycles. The physics of interest is slower than a block or is computed from
the load at the full rate before it is averaged like the counts, and a tenth of the rows makes a hundred hypotheses
affordable.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..physics.law import Array
from ..recording.document import Clock
from ..skin.layout import Layout

BLOCK_S = 0.1
MOST_ROWS = 3000  # longer recordings get longer blocks
SLIVER = 1e-3  # of a row
MOST_BLOCK_S = 0.3  # beyond it a ramp is no longer straight within a block


@dataclass(frozen=True, slots=True, eq=False)
class Load:
    """The load on a regular grid of the reference's own time.

    `pressure_pa` (N, 1): the same on every taxel.
    """

    start_s: float  # of the first row
    step_s: float
    pressure_pa: Array
    clock: Clock

    @property
    def t_s(self) -> Array:
        """(N,) reference's time of the rows."""
        grid: Array = np.linspace(self.start_s, self.start_s + self.step_s * (n := len(self.pressure_pa) - 1), n + 1)
        return grid

    def means(self, x: Array, edge_s: Array) -> Array:
        """(n, m) means of (N, m) `x`, on this grid, from `edge_s[0]` to `edge_s[1]` (2, n) of the reference's time."""
        grown = np.concatenate([np.zeros((1, x.shape[1])), np.cumsum((x[1:] + x[:-1]) / 2, axis=0)])
        # What lies beyond an end is told by its last sliver: a clock is still moved when blocks have been chosen.
        sliver = np.array([[0.0], [SLIVER]])
        at = np.clip((edge_s - self.start_s) / self.step_s, sliver, len(x) - 1 - 2 * SLIVER + sliver)
        before = at.astype(np.intp)
        share = (at - before)[..., None]
        total = grown[before] + share * (x[before] + share / 2 * (x[before + 1] - x[before]))
        span = np.maximum(at[1] - at[0], 1e-9)
        mean: Array = (total[1] - total[0]) / span[:, None]
        return mean


@dataclass(frozen=True, slots=True, eq=False)
class Observed:
    """One insole in one recording: n blocks of its m usable taxels."""

    name: str  # of the recording
    folder: Path
    layout: Layout
    slots: NDArray[np.intp]  # (m,) 12 · row of the triangle + taxel
    cycle_s: Array  # (cycles,) since the recording's first frame, those that are used
    first: NDArray[np.intp]  # (n,) cycle with which each block begins
    count: Array  # (n, m) mean of the block
    noise_count: Array  # (m,) standard deviation of one reading, not of a block
    temperature_c: Array | None  # (n,)
    load: Load
    offset_s: float  # what the reference's clock said at the first frame, and its rate, as the edges agree best
    rate: float
    clock_std: tuple[float, float]  # of these two
    paired_by_row: bool  # the reference had no times: its rows were to go with the cycles
    began_s: float  # what an own clock of the reference said at its first row, which its times count from here

    def reference_s(self, t_s: Array) -> Array:
        """What the reference's clock says when the taxels' says `t_s`, by the edges."""
        return self.offset_s + (1.0 + self.rate) * t_s

    @property
    def t_s(self) -> Array:
        """(n,) middle of each block."""
        return self.blocks(self.cycle_s)

    @property
    def edge_s(self) -> Array:
        """(2, n) between which moments each block lies: half a cycle before its first and after its last."""
        last = np.append(self.first[1:], len(self.cycle_s)) - 1
        half = float(np.median(np.diff(self.cycle_s))) / 2
        return np.stack([self.cycle_s[self.first] - half, self.cycle_s[last] + half])

    def blocks(self, of_cycles: Array) -> Array:
        """(n, …) mean over each block of what is given for each cycle (cycles, …)."""
        return block_means(of_cycles, self.first)


def block_means(of_cycles: Array, first: NDArray[np.intp]) -> Array:
    """(n, …) mean of the rows from `first[i]` up to `first[i + 1]` of (cycles, …)."""
    n = np.diff(np.append(first, len(of_cycles)))
    total = np.add.reduceat(of_cycles, first, axis=0)
    mean: Array = total / n.reshape(-1, *(1,) * (of_cycles.ndim - 1))
    return mean


def block_starts(cycle_s: Array) -> NDArray[np.intp]:
    """(n,) the cycle with which each block begins."""
    span = float(cycle_s[-1] - cycle_s[0])
    length_s = min(max(BLOCK_S, span / MOST_ROWS), MOST_BLOCK_S)
    block = ((cycle_s - cycle_s[0]) // length_s).astype(np.int64)
    starts: NDArray[np.intp] = np.flatnonzero(np.diff(block, prepend=-1))
    return starts


def stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last row of every run of set `flags` (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
