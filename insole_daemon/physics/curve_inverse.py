"""The static curve backwards: which activation gives a pressure.

The polynomial is followed from activation 0 as far as it rises, at most over ±REACH_COUNT; a pressure beyond what it
reaches there is taken for the last that it does. Newton's method, kept inside a bracket that shrinks.
"""

from __future__ import annotations

import numpy as np

from ..errors import EffectError
from .law import Array
from .static_curve import horner

REACH_COUNT = 510.0  # twice what a count can tell
_FINE_COUNT = 1e-12  # of REACH_COUNT: where the search ends
_MOST_STEPS = 60


class CurveInverse:
    """Of every taxel of (m,), whose coefficients of the powers 0 to k − 1 are `coefficients_pa` (m, k)."""

    def __init__(self, coefficients_pa: Array) -> None:
        self._coefficients = np.ascontiguousarray(coefficients_pa.T)
        powers = np.arange(1, len(self._coefficients))[:, None]
        self._slopes = self._coefficients[1:] * powers
        if not len(powers) or (self._slopes[0] <= 0).any():
            raise EffectError(
                "a taxel's static curve does not rise with the activation (its coefficient 1 is not above 0): "
                "no reading can be told from a load. Calibrate it anew, or leave the taxel out"
            )
        self._low, self._high = self._branch()
        self._least, self._most = horner(self._coefficients, self._low), horner(self._coefficients, self._high)

    def __call__(self, pressure_pa: Array) -> Array:
        """(n, m) activation, in counts, of `pressure_pa` (n, m)."""
        wanted = np.clip(pressure_pa, self._least, self._most)
        line = (wanted - self._coefficients[0]) / self._slopes[0]
        activation: Array = np.clip(line, self._low, self._high)
        if len(self._coefficients) == 2:
            return activation
        low = np.broadcast_to(self._low, wanted.shape).copy()
        high = np.broadcast_to(self._high, wanted.shape).copy()
        for _ in range(_MOST_STEPS):
            excess = horner(self._coefficients, activation)
            excess -= wanted
            above = excess > 0
            np.copyto(high, activation, where=above)
            np.copyto(low, activation, where=~above)
            with np.errstate(divide="ignore", invalid="ignore"):
                after = activation - excess / horner(self._slopes, activation)
            outside = ~((after >= low) & (after <= high))
            if outside.any():
                after = np.where(outside, (low + high) / 2, after)
            moved = float(np.abs(after - activation).max(initial=0.0))
            activation = after
            if moved < _FINE_COUNT * REACH_COUNT:
                break
        return activation

    def _branch(self) -> tuple[Array, Array]:
        """(m,) from where to where each curve rises through activation 0."""
        low, high = np.full(self._slopes.shape[1], -REACH_COUNT), np.full(self._slopes.shape[1], REACH_COUNT)
        for i, slope in enumerate(self._slopes.T):
            roots = np.roots(slope[::-1])
            real = roots.real[np.abs(roots.imag) < 1e-9 * (1 + np.abs(roots.real))]
            low[i] = max([-REACH_COUNT, *real[real < 0]])
            high[i] = min([REACH_COUNT, *real[real > 0]])
        return low, high
