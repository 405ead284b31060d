"""What a trial has covered of what tells effects apart, from the load that was seen, in any unit.

    rest         unloaded before anything else                 baselines
    slow         up and down within a trial's slowest loading  the static curve
    fast         the same, RATIO times as fast                 hysteresis (the same loop) from creep and lag (another)
    hold         a high load that stays                        creep and viscoelasticity from hysteresis
    recovery     unloaded after it                             creep, which comes back, from drift, which does not
    minor loops  turned round between the ends                 hysteresis: memory of turning points
    walking      steps                                         delay and lag, which slow loads do not show

Everything is relative to the highest load so far, so it is told anew when that grows. Which experiment excites which
effect is in Mayergoyz, Mathematical Models of Hysteresis (1991), ch. 1, and Findley et al., Creep and Relaxation of
Nonlinear Viscoelastic Materials (1976), ch. 5.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]

_UNLOADED, _HIGH = 0.1, 0.8  # of the highest load: at most, at least
_NOTHING = 0.05  # of the highest load, at most, before the first loading
_HELD = 0.6  # of the highest load, that a hold must be at
_STEADY = 0.05  # of the highest load, that a hold may wander to either side
_TURN = 0.12  # of the highest load, by which a turn counts
_LOOP_ENDS = 0.15, 0.95  # of the highest load, between which a minor loop has both its turns
_QUIET_STEP_S = 1.5  # the longest a foot bears load in a step


@dataclass(frozen=True, slots=True)
class Protocol:
    """How much of each is enough."""

    rest_s: float = 5.0
    slow_s: float = 15.0  # a rise from 0.1 to 0.8 of the highest load takes, and a fall
    ratio: float = 4.0  # by which the fast ones are quicker than the slowest
    hold_s: float = 60.0
    recovery_s: float = 60.0
    loops: int = 2
    steps: int = 20  # 0: nobody walks


@dataclass(frozen=True, slots=True)
class Item:
    """One part of the protocol."""

    name: str
    done: float  # 0 to 1
    seen: str  # so far
    ask: str  # of the person, while it is not done


def coverage(t_s: Array, load: Array, protocol: Protocol) -> tuple[Item, ...]:
    """How far each part of the protocol is covered by `load` (n,) at `t_s` (n,), from the beginning, in its order."""
    top = float(load.max(initial=0.0))
    if top <= 0.0:
        t_s, x = np.zeros(1), np.zeros(1)
    else:
        x = load / top
    trial = _Trial(t_s, x)
    rest_s = float(t_s[trial.first_loaded] - t_s[0]) if top > 0.0 else 0.0
    rises, falls = trial.ramps(up=True), trial.ramps(up=False)
    slow_s = min(max(rises, default=0.0), max(falls, default=0.0))
    fast_s = max(min(rises, default=np.inf), min(falls, default=np.inf))
    ratio = slow_s / fast_s if fast_s > 0 else 0.0
    hold_s, held_until = trial.hold()
    recovery_s = trial.unloaded_after(held_until) if hold_s >= protocol.hold_s else 0.0
    loops, steps = trial.minor_loops(), trial.steps()
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
            f"hold it steadily for {protocol.hold_s:.0f} s, at {_HELD:.0%} of the top or more",
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
    return tuple(Item(each.name, min(each.done, 1.0), each.seen, each.ask) for each in items)


class _Trial:
    """A load relative to its top, and its turns."""

    def __init__(self, t_s: Array, x: Array) -> None:
        self._t_s, self._x = t_s, x
        self._turns = _turns(x)

    @property
    def first_loaded(self) -> int:
        """The row in which it is first loaded, the last one if it never is."""
        loaded = self._x > _NOTHING
        return int(loaded.argmax()) if loaded.any() else len(self._x) - 1

    def ramps(self, up: bool) -> list[float]:
        """How long each full rise, or fall, took between the two levels."""
        found = []
        for first, last in zip(self._turns, self._turns[1:], strict=False):
            piece = self._x[first : last + 1] if up else self._x[first : last + 1][::-1]
            if piece[0] <= _UNLOADED and piece[-1] >= _HIGH:
                reached = int((piece >= _HIGH).argmax())
                left = reached - int((piece[: reached + 1][::-1] <= _UNLOADED).argmax())
                t_s = self._t_s[first : last + 1] if up else -self._t_s[first : last + 1][::-1]
                found.append(float(t_s[reached] - t_s[left]))
        return found

    def hold(self) -> tuple[float, int]:
        """The longest steady stretch at a high load, and where it ends."""
        best, first = (0.0, 0), 0
        for last in range(len(self._x)):
            while first < last and np.ptp(self._x[first : last + 1]) > 2 * _STEADY:
                first += 1
            if self._x[first : last + 1].min() >= _HELD - _STEADY:
                best = max(best, (float(self._t_s[last] - self._t_s[first]), last))
        return best

    def unloaded_after(self, row: int) -> float:
        """The longest unloaded stretch behind `row`."""
        return max((b - a for a, b in self._stretches(lambda x: x <= _UNLOADED) if a > self._t_s[row]), default=0.0)

    def minor_loops(self) -> int:
        """Turns down and up again, both between the ends."""
        low, high = _LOOP_ENDS
        inner = [low < self._x[turn] < high for turn in self._turns[1:-1]]
        valleys = [
            self._x[turn] < self._x[before] for before, turn in zip(self._turns, self._turns[1:-1], strict=False)
        ]
        return sum(
            valley and here and (before or after)
            for valley, here, before, after in zip(valleys, inner, [False, *inner], [*inner[1:], False], strict=False)
        )

    def steps(self) -> int:
        """Loads that come and go within a step's time."""
        return sum(b - a <= _QUIET_STEP_S for a, b in self._stretches(lambda x: x > _UNLOADED))

    def _stretches(self, of: Callable[[Array], NDArray[np.bool_]]) -> list[tuple[float, float]]:
        """When each stretch in which `of` the load is true began and ended; the last may go on."""
        inside = of(self._x).astype(int)
        edges = np.diff(inside, prepend=0, append=0)
        ends = np.minimum(np.flatnonzero(edges < 0), len(self._x) - 1)
        return list(zip(self._t_s[edges[:-1] > 0].tolist(), self._t_s[ends].tolist(), strict=True))


def _turns(x: Array) -> list[int]:
    """Rows of the turning points, first and last included; between two of them the load moves by _TURN at least."""
    turns, extreme, up = [0], 0, True
    for row in range(1, len(x)):
        if (x[row] - x[extreme]) * (1 if up else -1) >= 0:
            extreme = row
        elif abs(x[row] - x[extreme]) >= _TURN:
            turns.append(extreme)
            extreme, up = row, not up
    return [*turns, extreme] if extreme != turns[-1] else turns
