"""Fit delay and lag of the whole insole by moving and low-pass filtering the reference.

Both are too large for a linearised regressor, and each can stand for the other, so every combination is fitted, with
the other terms in the model.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize

from ...physics.law import Array
from .regression import D, Timing
from .solve import solve_shares

MOST_S = 0.8  # largest lag
START_S = 0.012  # initial delay or lag
TOLERANCE_S = 2e-4
SCALE_S = 0.01  # of the variables of the simplex


def fit_timing(
    design: D, chosen: Sequence[int], start: Timing, free: tuple[bool, bool], within_s: tuple[float, float]
) -> Timing:
    """Return the timing with the smallest residual, with the candidates `chosen`, by the Nelder-Mead simplex.

    `free`: whether delay and lag are fitted. `within_s`: limits of the delay. Readings are never early: a negative
    delay is an error of the clock.
    """
    if not any(free):
        return start
    small = design.subset(chosen)

    def timing(scaled: Array) -> Timing:
        values = iter(
            np.abs(scaled) * SCALE_S
            if not free[0]
            else np.concatenate([scaled[:1] * SCALE_S, np.abs(scaled[1:]) * SCALE_S])
        )
        delay_s = float(next(values)) if free[0] else start.delay_s
        lag_s = float(next(values)) if free[1] else start.lag_s
        return Timing(float(np.clip(delay_s, *within_s)), min(lag_s, MOST_S))

    def residual_sum(scaled: Array) -> float:
        moved = small.retimed(timing(scaled))
        return moved.total - solve_shares(moved, moved.candidates)[1]

    start_values = [value for value, yes in zip((start.delay_s, start.lag_s), free, strict=True) if yes]
    # Edges have aligned a free clock already, so the search starts near 0 instead of at START_S.
    earliest_s, latest_s = within_s
    guess_s = 0.0 if earliest_s < 0.0 < latest_s else START_S if latest_s > 0.0 else -START_S
    defaults = (guess_s if free[0] else START_S, START_S)
    initial = (
        np.array([value if value else default for value, default in zip(start_values, defaults, strict=False)])
        / SCALE_S
    )
    result = minimize(
        residual_sum, initial, method="Nelder-Mead",
        options={"xatol": TOLERANCE_S / SCALE_S, "fatol": 0.5, "maxfev": 60, "initial_simplex": _simplex(initial)},
    )  # fmt: skip
    return timing(result.x)


def _simplex(initial: Array) -> Array:
    return np.concatenate([initial[None], initial + 1.5 * np.eye(len(initial))])
