"""Delay and lag of the whole insole, exactly: the reference is moved and low-passed, whatever else is in the model.

Both are large against what a linear column can stand for, and each other's best mimic; so every combination of them is
a hypothesis of its own, whose times are searched for with the other terms in the model.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize

from ...physics.law import Array
from .regression import D, Timing
from .solve import solve_shares

MOST_S = 0.8
START_S = 0.012
TOLERANCE_S = 2e-4


def fit_timing(
    design: D, chosen: Sequence[int], start: Timing, free: tuple[bool, bool], within_s: tuple[float, float]
) -> Timing:
    """The timing that leaves the least with the candidates `chosen`; `free`: whether delay and lag are searched for.

    `within_s`: of the delay. Readings do not come early: that is a clock that is not what it is said to be.
    """
    if not any(free):
        return start
    small = design.subset(chosen)

    def timing(x: Array) -> Timing:
        values = iter(np.abs(x) * 0.01 if not free[0] else np.concatenate([x[:1] * 0.01, np.abs(x[1:]) * 0.01]))
        delay_s = float(next(values)) if free[0] else start.delay_s
        lag_s = float(next(values)) if free[1] else start.lag_s
        return Timing(float(np.clip(delay_s, *within_s)), min(lag_s, MOST_S))

    def left(x: Array) -> float:
        moved = small.retimed(timing(x))
        return moved.total - solve_shares(moved, moved.candidates)[1]

    first = [value for value, yes in zip((start.delay_s, start.lag_s), free, strict=True) if yes]
    # A clock that edges have aligned is near where it should be: no worse place is taken for a better one.
    earliest_s, latest_s = within_s
    guess_s = 0.0 if earliest_s < 0.0 < latest_s else START_S if latest_s > 0.0 else -START_S
    defaults = (guess_s if free[0] else START_S, START_S)
    initial = np.array([value if value else default for value, default in zip(first, defaults, strict=False)]) / 0.01
    found = minimize(
        left, initial, method="Nelder-Mead",
        options={"xatol": TOLERANCE_S / 0.01, "fatol": 0.5, "maxfev": 60, "initial_simplex": _simplex(initial)},
    )  # fmt: skip
    return timing(found.x)


def _simplex(initial: Array) -> Array:
    return np.concatenate([initial[None], initial + 1.5 * np.eye(len(initial))])
