"""Invert the static curve: find the activation that gives a pressure.

Only the rising part of the polynomial around activation 0 is used, at most ±REACH_COUNT; a pressure beyond it is
clipped to it. The method is Newton's with a shrinking bracket.
"""

from __future__ import annotations

import numpy as np

from ..errors import EffectError
from .law import Array
from .static_curve import horner

REACH_COUNT = 510.0  # twice the range of a count
_FINE_COUNT = 1e-12  # relative step, of REACH_COUNT, at which the iteration stops
_MAX_STEPS = 60


class CurveInverse:
    """Inverse of m polynomials with coefficients `coefficients_pa` (m, k) of the powers 0 to k − 1."""

    def __init__(self, coefficients_pa: Array) -> None:
        self._coefficients = np.ascontiguousarray(coefficients_pa.T)
        powers = np.arange(1, len(self._coefficients))[:, None]
        self._slopes = self._coefficients[1:] * powers
        if not len(powers) or (self._slopes[0] <= 0).any():
            raise EffectError(
                "a taxel's static curve does not rise with the activation (its coefficient 1 is not above 0): "
                "its reading does not determine a load. Calibrate it again, or leave the taxel out"
            )
        self._low, self._high = self._find_rising_range()
        self._lowest_pa, self._highest_pa = (
            horner(self._coefficients, self._low),
            horner(self._coefficients, self._high),
        )

    def __call__(self, pressure_pa: Array) -> Array:
        """Return (n, m) activation in counts for `pressure_pa` (n, m)."""
        target_pa = np.clip(pressure_pa, self._lowest_pa, self._highest_pa)
        line = (target_pa - self._coefficients[0]) / self._slopes[0]
        activation: Array = np.clip(line, self._low, self._high)
        if len(self._coefficients) == 2:
            return activation
        low = np.broadcast_to(self._low, target_pa.shape).copy()
        high = np.broadcast_to(self._high, target_pa.shape).copy()
        for _ in range(_MAX_STEPS):
            error = horner(self._coefficients, activation)
            error -= target_pa
            is_above = error > 0
            np.copyto(high, activation, where=is_above)
            np.copyto(low, activation, where=~is_above)
            with np.errstate(divide="ignore", invalid="ignore"):
                updated = activation - error / horner(self._slopes, activation)
            is_outside = ~((updated >= low) & (updated <= high))
            if is_outside.any():
                updated = np.where(is_outside, (low + high) / 2, updated)
            largest_step = float(np.abs(updated - activation).max(initial=0.0))
            activation = updated
            if largest_step < _FINE_COUNT * REACH_COUNT:
                break
        return activation

    def _find_rising_range(self) -> tuple[Array, Array]:
        """Return (m,) lower and upper end of the rising part of each curve around activation 0."""
        low, high = np.full(self._slopes.shape[1], -REACH_COUNT), np.full(self._slopes.shape[1], REACH_COUNT)
        for i, slope in enumerate(self._slopes.T):
            roots = np.roots(slope[::-1])
            real = roots.real[np.abs(roots.imag) < 1e-9 * (1 + np.abs(roots.real))]
            low[i] = max([-REACH_COUNT, *real[real < 0]])
            high[i] = min([REACH_COUNT, *real[real > 0]])
        return low, high
