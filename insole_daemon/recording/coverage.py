"""Determine how much of a trial protocol a load has covered; the load may have any unit.

    phase        load                                     separates
    rest         unloaded before anything else            baselines
    slow         slow rise and fall                       the static curve
    fast         the same, `ratio` times as fast          hysteresis (same loop) from creep and lag (another loop)
    hold         constant high load                       creep and viscoelasticity from hysteresis
    recovery     unloaded after the hold                  creep, which recovers, from drift, which does not
    minor loops  reversals between the extremes           hysteresis: memory of turning points
    walking      steps                                    delay and lag, which slow loads do not show

All loads are relative to the highest load so far, so coverage is recomputed as that grows. Which experiment excites
which effect: Mayergoyz, Mathematical Models of Hysteresis (1991), ch. 1, and Findley et al., Creep and Relaxation of
Nonlinear Viscoelastic Materials (1976), ch. 5.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]

_UNLOADED_MAX, _HIGH_MIN = 0.1, 0.8  # fractions of the highest load
_REST_MAX = 0.05  # fraction of the highest load before the first loading
_HOLD_MIN = 0.6  # fraction of the highest load that a hold must reach
_HOLD_TOLERANCE = 0.05  # fraction of the highest load by which a hold may vary to either side
_TURN_MIN = 0.12  # fraction of the highest load between two turning points
_LOOP_RANGE = 0.15, 0.95  # fractions of the highest load between which both turns of a minor loop lie
_STEP_MAX_S = 1.5  # longest stance of a step


@dataclass(frozen=True, slots=True)
class Protocol:
    """The amount of each phase that suffices."""

    rest_s: float = 5.0
    slow_s: float = 15.0  # duration of a rise from 0.1 to 0.8 of the highest load, and of a fall
    ratio: float = 4.0  # slowest ramp's duration over the fastest one's
    hold_s: float = 60.0
    recovery_s: float = 60.0
    loops: int = 2
    steps: int = 20  # 0: no walking


@dataclass(frozen=True, slots=True)
class Item:
    """One phase of the protocol and its state."""

    name: str
    done: float  # 0 to 1
    seen: str  # amount so far, with its unit
    ask: str  # instruction for the person while it is not done


def compute_coverage(t_s: Array, load: Array, protocol: Protocol) -> tuple[Item, ...]:
    """Return the coverage of every phase by `load` (n,) at times `t_s` (n,), in the order of the protocol."""
    top = float(load.max(initial=0.0))
    if top <= 0.0:
        t_s, x = np.zeros(1), np.zeros(1)
    else:
        x = load / top
    trial = _Trial(t_s, x)
    rest_s = float(t_s[trial.first_loaded] - t_s[0]) if top > 0.0 else 0.0
    rises, falls = trial.ramp_durations(up=True), trial.ramp_durations(up=False)
    slow_s = min(max(rises, default=0.0), max(falls, default=0.0))
    fast_s = max(min(rises, default=np.inf), min(falls, default=np.inf))
    ratio = slow_s / fast_s if fast_s > 0 else 0.0
    hold_s, held_until = trial.longest_hold()
    recovery_s = trial.longest_unloaded_after(held_until) if hold_s >= protocol.hold_s else 0.0
    loops, steps = trial.count_minor_loops(), trial.count_steps()
    items = [
        Item("rest", rest_s / protocol.rest_s, f"{rest_s:.0f} s", f"leave it unloaded for {protocol.rest_s:.0f} s"),
        Item(
            "slow", slow_s / protocol.slow_s, f"{slow_s:.0f} s",
            f"load it slowly, over {protocol.slow_s:.0f} s or more, up to the top, and unload it as slowly",
        ),
        Item(
            "fast", ratio / protocol.ratio, f"{ratio:.1f} times as fast",
            f"load it up to the top and unload it again at least {protocol.ratio:g} times as fast as before",
        ),
        Item(
            "hold", hold_s / protocol.hold_s, f"{hold_s:.0f} s",
            f"hold it steadily for {protocol.hold_s:.0f} s, at {_HOLD_MIN:.0%} of the top or more",
        ),
        Item(
            "recovery", recovery_s / protocol.recovery_s, f"{recovery_s:.0f} s",
            f"after the hold leave it unloaded for {protocol.recovery_s:.0f} s",
        ),
        Item(
            "minor loops", loops / protocol.loops, f"{loops}",
            f"load it half, and {protocol.loops} times turn back and up again without unloading it",
        ),
    ]  # fmt: skip
    if protocol.steps:
        items.append(Item("walking", steps / protocol.steps, f"{steps} steps", f"walk {protocol.steps} steps"))
    return tuple(Item(item.name, min(item.done, 1.0), item.seen, item.ask) for item in items)


class _Trial:
    """A load relative to its maximum, with its turning points."""

    def __init__(self, t_s: Array, x: Array) -> None:
        self._t_s, self._x = t_s, x
        self._turns = _find_turns(x)

    @property
    def first_loaded(self) -> int:
        """Return the first loaded row, or the last row if none is loaded."""
        loaded = self._x > _REST_MAX
        return int(loaded.argmax()) if loaded.any() else len(self._x) - 1

    def ramp_durations(self, up: bool) -> list[float]:
        """Return the duration in s of each full rise (or fall) between the two levels."""
        durations = []
        for first, last in zip(self._turns, self._turns[1:], strict=False):
            piece = self._x[first : last + 1] if up else self._x[first : last + 1][::-1]
            if piece[0] <= _UNLOADED_MAX and piece[-1] >= _HIGH_MIN:
                reached = int((piece >= _HIGH_MIN).argmax())
                departed = reached - int((piece[: reached + 1][::-1] <= _UNLOADED_MAX).argmax())
                t_s = self._t_s[first : last + 1] if up else -self._t_s[first : last + 1][::-1]
                durations.append(float(t_s[reached] - t_s[departed]))
        return durations

    def longest_hold(self) -> tuple[float, int]:
        """Return the duration in s and the last row of the longest constant high load."""
        best, first = (0.0, 0), 0
        for last in range(len(self._x)):
            while first < last and np.ptp(self._x[first : last + 1]) > 2 * _HOLD_TOLERANCE:
                first += 1
            if self._x[first : last + 1].min() >= _HOLD_MIN - _HOLD_TOLERANCE:
                best = max(best, (float(self._t_s[last] - self._t_s[first]), last))
        return best

    def longest_unloaded_after(self, row: int) -> float:
        """Return the duration in s of the longest unloaded interval after `row`."""
        return max(
            (b - a for a, b in self._find_intervals(lambda x: x <= _UNLOADED_MAX) if a > self._t_s[row]), default=0.0
        )

    def count_minor_loops(self) -> int:
        """Count the valleys inside the loop range with a neighbouring peak inside it too."""
        low, high = _LOOP_RANGE
        inner = [low < self._x[turn] < high for turn in self._turns[1:-1]]
        valleys = [
            self._x[turn] < self._x[before] for before, turn in zip(self._turns, self._turns[1:-1], strict=False)
        ]
        return sum(
            valley and is_inner and (before or after)
            for valley, is_inner, before, after in zip(
                valleys, inner, [False, *inner], [*inner[1:], False], strict=False
            )
        )

    def count_steps(self) -> int:
        """Count the loaded intervals that are no longer than a step."""
        return sum(b - a <= _STEP_MAX_S for a, b in self._find_intervals(lambda x: x > _UNLOADED_MAX))

    def _find_intervals(self, condition: Callable[[Array], NDArray[np.bool_]]) -> list[tuple[float, float]]:
        """Return start and end time of each interval in which `condition` of the load holds."""
        inside = condition(self._x).astype(int)
        edges = np.diff(inside, prepend=0, append=0)
        ends = np.minimum(np.flatnonzero(edges < 0), len(self._x) - 1)
        return list(zip(self._t_s[edges[:-1] > 0].tolist(), self._t_s[ends].tolist(), strict=True))


def _find_turns(x: Array) -> list[int]:
    """Return the rows of the turning points, which differ by _TURN_MIN or more, with the first and the last row."""
    turns, extreme, up = [0], 0, True
    for row in range(1, len(x)):
        if (x[row] - x[extreme]) * (1 if up else -1) >= 0:
            extreme = row
        elif abs(x[row] - x[extreme]) >= _TURN_MIN:
            turns.append(extreme)
            extreme, up = row, not up
    return [*turns, extreme] if extreme != turns[-1] else turns
