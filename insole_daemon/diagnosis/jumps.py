"""What happens once, from one cycle to the next: a board that took its baselines anew, a reference that jumped.

A jump is told by the difference of two short means on either side of a moment: what has memory changes slowly, what
snaps does so again in every cycle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ..physics.law import Array
from ..skin.geometry import N_TAXELS
from .observed import Observed, stretches

SIDE_S = 0.8  # of the means on either side
NEAR_S = 0.25  # of its moment, within which a jump was seen first
SIGMAS = 6.0
LEAST_COUNT = 0.8
MOST_JUMPS = 4  # of one insole in one recording: what happens more often is physics
AT_ONCE = 0.5  # of the whole shift that is seen at the jump itself, at the least: else it drifts
SETTLES = 0.6  # of a board's unrest that remains when its jump is known, at the most
SPIKE_S = 0.25  # the longest spike of a reference
SPIKE = 0.02  # of the span: the least


@dataclass(frozen=True, slots=True)
class Jump:
    """From `t_s` on the readings of `boards` are `shift_count` off."""

    t_s: float
    boards: tuple[int, ...]
    shift_count: float  # added to the count


def strongest(observed: Observed, residual_count: Array) -> Jump | None:
    """The largest jump of one board, by what a hypothesis leaves: (n, m) activation in counts."""
    mean, boards = _boards(observed, residual_count)
    t = observed.t_s
    side = max(round(SIDE_S / float(np.median(np.diff(t)))), 2)
    found: Jump | None = None
    for own, board in zip(mean.T, boards, strict=True):
        if len(t) < 6 * side:
            continue
        step = _steps(own, side)
        p = int(np.argmax(np.abs(step)))
        least = max(SIGMAS * float(np.median(np.abs(step))) / 0.6745, LEAST_COUNT)
        larger = found is None or abs(step[p]) > abs(found.shift_count)
        if abs(step[p]) > least and larger and _abrupt(own, p, side):
            found = Jump(float(t[p]), (board,), -float(step[p]))
    return found


def nearer(observed: Observed, residual_count: Array, jump: Jump, moved_count: float) -> Jump:
    """The jump at the moment at which it happened, by what is left (n, m) beside one that moves by `moved_count`.

    Activations, in counts: what is left between the moment that was taken and the right one is the jump itself.
    """
    mean, boards = _boards(observed, residual_count)
    (own,) = (each for each, board in zip(mean.T, boards, strict=True) if board in jump.boards)
    start, end = observed.edge_s
    near = np.abs(observed.t_s - jump.t_s) < NEAR_S
    late_s = -float(np.sum((own * (end - start))[near])) / moved_count
    return replace(jump, t_s=jump.t_s + float(np.clip(late_s, -NEAR_S, NEAR_S)))


def abrupt(t_s: Array, x: Array) -> float | None:
    """When (n,) `x` jumps most, if it does so at once."""
    side = max(round(SIDE_S / float(np.median(np.diff(t_s)))), 2)
    p = int(np.argmax(np.abs(_steps(x, side))))
    return float(t_s[p]) if _abrupt(x, p, side) else None


def unrest(observed: Observed, residual_count: Array, boards: tuple[int, ...]) -> float:
    """Mean square of what boards do that the others do not, counts²."""
    mean, every = _boards(observed, residual_count)
    return float(np.mean(mean[:, np.isin(every, boards)] ** 2))


def _boards(observed: Observed, residual_count: Array) -> tuple[Array, list[int]]:
    """(n, boards) mean of each, less what is common to most of them."""
    board_of = observed.layout.identities[:, 0][observed.slots // N_TAXELS]
    boards = np.unique(board_of).tolist()
    mean = np.stack([residual_count[:, board_of == board].mean(axis=1) for board in boards], axis=1)
    own: Array = mean - np.median(mean, axis=1, keepdims=True) if len(boards) > 2 else mean
    return own, boards


def _steps(x: Array, side: int) -> Array:
    """(n,) mean of the `side` rows from each on, less that of those before it; 0 at the ends."""
    total = np.concatenate([[0.0], np.cumsum(x)])
    at = np.arange(side, len(x) - side)
    found = np.zeros(len(x))
    found[at] = (total[at + side] - 2 * total[at] + total[at - side]) / side
    return found


def _abrupt(x: Array, p: int, side: int) -> bool:
    """Whether most of the jump is there within two rows."""
    whole = x[p + 1 : p + side].mean() - x[p - side : p - 1].mean()
    near = np.mean(x[p + 1 : p + 3]) - np.mean(x[p - 3 : p - 1])
    return bool(abs(near) > 0.75 * abs(whole))


def despiked(time_s: Array, pressure_pa: Array) -> tuple[Array, NDArray[np.bool_]]:
    """The readings of a reference with its spikes taken out, and which (n,) were."""
    known = ~np.isnan(pressure_pa)
    p = pressure_pa[known]
    spike = np.zeros(len(pressure_pa), bool)
    if len(p) < 20:
        return pressure_pa, spike
    window = 2 * max(round(SPIKE_S / max(float(np.median(np.diff(time_s[known]))), 1e-6)), 2) + 1
    off = np.abs(p - median_filter(p, window, mode="nearest"))
    noise = 1.4826 * float(np.median(np.abs(np.diff(p)))) / np.sqrt(2)
    far = off > max(SIGMAS * noise, SPIKE * float(np.subtract(*np.quantile(p, [0.999, 0.001]))))
    # At a turn of a fast ramp the median lags behind: a spike leaves its neighbours by more than the load ever moves.
    rate = np.abs(np.diff(p, prepend=p[:1]))
    # Rates of the spikes themselves are not usual, however many there are.
    still = ~(far | np.roll(far, 1) | np.roll(far, -1))
    usual = float(np.quantile(rate[still], 0.99)) if still.any() else np.inf
    keep = np.zeros(len(p), bool)
    for a, b in stretches(far):
        if rate[max(a - 1, 0) : b + 3].max() > 3 * usual and b - a <= window // 2:
            keep[max(a - 1, 0) : b + 2] = True
    spike[np.flatnonzero(known)[keep]] = True
    cleaned = pressure_pa.copy()
    good = known & ~spike
    cleaned[spike] = np.interp(time_s[spike], time_s[good], pressure_pa[good])
    return cleaned, spike


def columns(observed: Sequence[Observed], found: Sequence[Sequence[Jump]]) -> Array:
    """(n, j) a column for every jump: in its recording, what part of each block comes after its moment."""
    every = [(i, jump) for i, own in enumerate(found) for jump in own]
    ends = np.cumsum([0, *(len(each.first) for each in observed)])
    made = np.zeros((ends[-1], len(every)))
    for j, (i, jump) in enumerate(every):
        start, end = observed[i].edge_s
        made[ends[i] : ends[i + 1], j] = np.clip((end - jump.t_s) / (end - start), 0.0, 1.0)
    return made
