"""Check that a load rises and falls often enough to identify effects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import UndecidableError
from ..physics.law import Array

HELD = 0.03  # of the span: a load within this range counts as held
STEP_S = 3.0  # the shortest hold between two steps
LEAST_CYCLES = 3
TURN = 0.15  # of the span: smallest reversal that counts
OUTER, ONE_SPEED = (0.1, 0.9), 1.3  # quantiles of the speeds of rises and falls, and their largest ratio if it is one


def require_cycles(name: str, loads: Sequence[Array], steps_s: Sequence[float], span: float) -> None:
    """Raise UndecidableError if the loads (N,) of all recordings reverse and are held too rarely.

    `steps_s`: time between two rows of each load; `span`: of all loads.
    """
    reversals = sum(len(_turns(load, TURN * span)) for load in loads)
    holds = [hold for load, step_s in zip(loads, steps_s, strict=True) for hold in _holds(load, step_s, span)]
    steps = sum(seconds > STEP_S for seconds, _ in holds)
    if reversals < 2 * LEAST_CYCLES - 1 and not (reversals and steps >= 2 * LEAST_CYCLES):
        raise UndecidableError(
            f"{name}: the load turns {reversals} times and is held {steps} times, expected at least "
            f"{LEAST_CYCLES} cycles of loading and unloading, or as many steps up and down: one ramp fits any physics. "
            "Record more, at two speeds, with holds"
        )


def has_one_speed(load: Array, step_s: float) -> bool:
    """Return whether a load (N,) rises and falls at one speed, or in one time, and is not held.

    The area of a loop tells memories apart by how it changes with speed, and a hold by how readings go on changing:
    under such a load a hysteresis, a creep and a viscoelasticity make the same loops. `step_s`: time between two rows.
    """
    span = float(np.ptp(load))
    turns = np.array(_turns(load, TURN * span), np.intp)
    if len(turns) < 2:
        return False
    speed = np.abs(np.diff(load[turns])) / np.diff(turns)
    slow, fast = np.quantile(speed, OUTER)
    longest_s = max((seconds for seconds, _ in _holds(load, step_s, span)), default=0.0)
    return bool(fast < ONE_SPEED * slow and longest_s < STEP_S)


def _turns(load: Array, least: float) -> list[int]:
    """Return the rows from which `load` reverses by at least `least`."""
    turns: list[int] = []
    rising: bool | None = None
    lowest = highest = 0
    for row, value in enumerate(load.tolist()):
        lowest = row if value < load[lowest] else lowest
        highest = row if value > load[highest] else highest
        if rising is not False and load[highest] - value > least:
            turns += [highest] if rising else []
            rising, lowest = False, row
        elif rising is not True and value - load[lowest] > least:
            turns += [lowest] if rising is False else []
            rising, highest = True, row
    return turns


def _holds(load: Array, step_s: float, span: float) -> list[tuple[float, float]]:
    """Return duration in s and level, as a share of the span, of each stretch in which the load stays within HELD.

    Slow ramps, which move evenly within a stretch, are left out.
    """
    holds = []
    start, low, high = 0, float(load[0]), float(load[0])
    for row, value in enumerate([*load.tolist(), np.inf]):
        if max(high, value) - min(low, value) > HELD * span:
            quarter = (row - start) // 4
            if abs(load[row - 1 - quarter] - load[start + quarter]) < HELD / 4 * span:
                holds.append(((row - start) * step_s, (low + high) / 2 / span))
            start, low, high = row, value, value
        low, high = min(low, value), max(high, value)
    return holds
