"""Static curves from activation to pressure: polynomials, and straight lines beyond where they are known."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial.polynomial import polyder

from ...physics.law import Array
from ..operators import AT_ONCE, polynomial

LEAST_SLOPE = 0.25  # of a curve, as a share of its mean slope
HIGHEST_ACTIVATION = 255  # counts


def turning_count(coefficients: Array, highest_count: Array | float) -> Array:
    """Return the activation (...) from which curves (k, ...) rise by less than LEAST_SLOPE of their mean; inf if none.

    A static curve cannot turn over: there, readings are beyond those that it was fitted to. `highest_count` (...): up
    to which the curves are used; what a polynomial does beyond tells nothing.
    """
    parts = np.linspace(0.0, 1.0, HIGHEST_ACTIVATION + 1)[1:].reshape(-1, *[1] * (coefficients.ndim - 1))
    count = parts * np.broadcast_to(np.minimum(highest_count, HIGHEST_ACTIVATION), coefficients.shape[1:])
    slope, mean_slope = polynomial(count, _derivative(coefficients)), polynomial(count, coefficients[1:])
    is_past_steepest = np.cumsum(slope == slope.max(axis=0), axis=0) > 0
    is_flat = (slope < LEAST_SLOPE * mean_slope) & is_past_steepest
    first = np.take_along_axis(count, np.argmax(is_flat, axis=0)[None], axis=0)[0]
    return np.where(is_flat.any(axis=0), first, np.inf)


@dataclass(frozen=True, eq=False)
class StaticCurves:
    """Polynomials g of taxels (...), straight above `top_count` and below zero, where none falls."""

    coefficients: Array  # (k, ...) Pa, Pa per count, …
    top_count: Array  # (...)

    def pressure_pa(self, activation_count: Array) -> Array:
        """Return the pressure (n, ...) at activations (n, ...)."""
        pressure = np.empty(activation_count.shape)
        for first in range(0, len(pressure), AT_ONCE):
            count = activation_count[first : first + AT_ONCE]
            inside = self._inside(count)
            rows = polynomial(inside, self.coefficients)
            beyond = np.subtract(count, inside, out=inside)
            rows += beyond * np.where(beyond < 0.0, self._slope_below, self._slope_above)
            pressure[first : first + AT_ONCE] = rows
        return pressure

    def slope_pa(self, activation_count: Array) -> Array:
        """Return the slope (n, ...) at activations (n, ...), Pa per count, and at least LEAST_SLOPE of their mean."""
        slope = polynomial(self._inside(activation_count), _derivative(self.coefficients))
        np.copyto(slope, self._slope_above, where=activation_count > self.top_count)
        least = LEAST_SLOPE * np.mean(slope, axis=0)
        return np.asarray(np.maximum(slope, np.maximum(least, 0.0), out=slope))

    def _inside(self, activation_count: Array) -> Array:
        """Return the nearest activation at which the curves are not straight."""
        return np.asarray(np.clip(activation_count, 0.0, self.top_count))

    @cached_property
    def _slope_below(self) -> Array:
        return np.asarray(np.maximum(self.coefficients[1], 0.0))

    @cached_property
    def _slope_above(self) -> Array:
        """Return the slope (...) above the top: that of the top, or the mean if a curve turns there."""
        slope = polynomial(self.top_count[None], _derivative(self.coefficients))[0]
        return np.where(slope < LEAST_SLOPE * self._mean_slope, self._mean_slope, slope)

    @cached_property
    def _mean_slope(self) -> Array:
        """Return the mean slope (...) from zero to the top."""
        return np.asarray(polynomial(self.top_count[None], self.coefficients[1:])[0])


def _derivative(coefficients: Array) -> Array:
    """Return the coefficients (k − 1, ...) of the slopes of curves (k, ...)."""
    return np.asarray(polyder(coefficients), np.float64)
