"""What a load is like: how much of the physics it can show."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ..errors import DiagnosisError, UndecidableError
from ..physics.law import Array
from .candidate import Excitation
from .observed import Observed

MOVES = 0.03  # of the span within a second: a ramp whose speed counts
HELD = 0.03  # of the span, within which a load stays that is held
STEP_S = 3.0  # the shortest hold between two steps
SPEEDS_APART = 2.0
LEAST_CYCLES = 3
TURN = 0.15  # of the span: a reversal counts from there on


def excitation(observed: Sequence[Observed]) -> Excitation:
    """Of all recordings together; DiagnosisError where nothing moves, UndecidableError where too little does."""
    loads = [each.load.pressure_pa.mean(axis=1) for each in observed]
    span = max(float(np.ptp(load)) for load in loads)
    if not span > 0:
        raise DiagnosisError(
            f"{observed[0].folder}: the reference says {loads[0][0]:g} Pa throughout, expected a load that rises and "
            "falls at least three times: was the instrument recorded?"
        )
    steps_s = [each.load.step_s for each in observed]
    reversals, holds = require_cycles(str(observed[0].folder), loads, steps_s, span)
    ramps = []
    for each, load in zip(observed, loads, strict=True):
        second = max(round(1.0 / each.load.step_s), 1)
        rate = (load[second:] - load[:-second]) / (second * each.load.step_s)
        ramps += _ramps(rate, MOVES * span, second)
    warm = [each.temperature_c for each in observed if each.temperature_c is not None]
    temperature = np.concatenate(warm) if len(warm) == len(observed) else np.zeros(1)
    return Excitation(
        span_pa=max(float(np.ptp(each.load.pressure_pa, axis=0).max()) for each in observed),
        two_speeds=_two_speeds(ramps),
        hold_s=max((seconds for seconds, share in holds if share > 0.2), default=0.0),
        seconds=max(float(each.cycle_s[-1] - each.cycle_s[0]) for each in observed),
        temperature_span_k=float(np.subtract(*np.quantile(temperature, [0.99, 0.01]))),
        temperature_c=float(temperature.mean()),
        temperature_reverses=_reversals(_smooth(temperature), 0.3 * max(float(np.ptp(temperature)), 1e-9)) > 0,
        reversals=reversals,
        own_clock=observed[0].load.clock == "own",
    )


def require_cycles(
    name: str, loads: Sequence[Array], steps_s: Sequence[float], span: float
) -> tuple[int, list[tuple[float, float]]]:
    """How often loads (N,) of all recordings turn, and their holds: seconds and share of `span`.

    `steps_s`: between two rows of each. UndecidableError where that is too little to tell anything by.
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
    return reversals, holds


def _reversals(load: Array, least: float) -> int:
    """How often `load` turns and goes back by `least`."""
    turns, rising = 0, None
    low = high = float(load[0])
    for value in load.tolist():
        low, high = min(low, value), max(high, value)
        if rising is not False and high - value > least:
            turns, rising, low = turns + (rising is True), False, value
        elif rising is not True and value - low > least:
            turns, rising, high = turns + (rising is False), True, value
    return turns


def _ramps(rate: Array, least: float, shortest: int) -> list[float]:
    """The median speed of every stretch in which the load moves one way for `shortest` rows or longer."""
    way = np.where(rate > least, 1, np.where(rate < -least, -1, 0))
    edges = np.flatnonzero(np.diff(way, prepend=2, append=2))
    return [float(np.median(np.abs(rate[a:b]))) for a, b in pairwise(edges) if way[a] and b - a >= shortest]


def _two_speeds(ramps: Sequence[float]) -> bool:
    """Whether at least two ramps each are clearly slower and faster."""
    ordered = np.sort(ramps)
    return len(ordered) >= 4 and bool(ordered[-2] > SPEEDS_APART * ordered[1])


def _holds(load: Array, step_s: float, span: float) -> list[tuple[float, float]]:
    """How long, and at which share of the span, the load stays within HELD of it: one stretch after another.

    A slow ramp stays so for a while too, but moves evenly: those are left out.
    """
    found = []
    start, low, high = 0, float(load[0]), float(load[0])
    for row, value in enumerate([*load.tolist(), np.inf]):
        if max(high, value) - min(low, value) > HELD * span:
            quarter = (row - start) // 4
            if abs(load[row - 1 - quarter] - load[start + quarter]) < HELD / 4 * span:
                found.append(((row - start) * step_s, (low + high) / 2 / span))
            start, low, high = row, value, value
        low, high = min(low, value), max(high, value)
    return found


def _smooth(x: Array) -> Array:
    n = max(len(x) // 50, 1)
    found: Array = np.convolve(x, np.ones(n) / n, mode="valid")
    return found
