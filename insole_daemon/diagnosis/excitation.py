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


def require_cycles(name: str, loads: Sequence[Array], steps_s: Sequence[float], span: float) -> None:
    """Raise UndecidableError if the loads (N,) of all recordings reverse and are held too rarely.

    `steps_s`: time between two rows of each load; `span`: of all loads.
    """
    reversals = sum(_reversals(load, TURN * span) for load in loads)
    holds = [hold for load, step_s in zip(loads, steps_s, strict=True) for hold in _holds(load, step_s, span)]
    steps = sum(seconds > STEP_S for seconds, _ in holds)
    if reversals < 2 * LEAST_CYCLES - 1 and not (reversals and steps >= 2 * LEAST_CYCLES):
        raise UndecidableError(
            f"{name}: the load turns {reversals} times and is held {steps} times, expected at least "
            f"{LEAST_CYCLES} cycles of loading and unloading, or as many steps up and down: one ramp fits any physics. "
            "Record more, at two speeds, with holds"
        )


def _reversals(load: Array, least: float) -> int:
    """Return how often `load` reverses by at least `least`."""
    turns, rising = 0, None
    low = high = float(load[0])
    for value in load.tolist():
        low, high = min(low, value), max(high, value)
        if rising is not False and high - value > least:
            turns, rising, low = turns + (rising is True), False, value
        elif rising is not True and value - low > least:
            turns, rising, high = turns + (rising is False), True, value
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
