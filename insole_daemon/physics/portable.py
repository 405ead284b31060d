"""Compute exp, ln and sin from additions, multiplications and divisions, with the same bits on every machine.

numpy's functions differ in the last bit with the CPU's vector unit and the C library, and BLAS with the order of its
sums. This module uses only operations that IEEE 754 rounds exactly, so that a simulated reading is the same everywhere.
The relative error is below 3e-16 (relative to 1 for the sine; below 1e-15 for e^x − 1 and for powers).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # their sum is ln 2 to 2^-86
_EXP = [1 / math.factorial(k) for k in range(14)]  # for |r| up to ln 2 / 2
_ARTANH = [1 / (2 * k + 1) for k in range(12)]  # for squares up to 0.03
_SIN = [(-1) ** k / math.factorial(2 * k + 1) for k in range(11)]  # for angles up to π / 2
_MAX_SCALAR_SIZE = 16
_MIN_EXPONENT = -700.0  # exp is taken as 0 below


def exp(x: ArrayLike) -> NDArray[np.float64]:
    """Return e to the power of `x`, of any shape, at most 700."""
    values = np.asarray(x, np.float64)
    power = np.rint(values * (1 / math.log(2)))
    r = (values - power * _LN2_HIGH) - power * _LN2_LOW
    result: NDArray[np.float64] = np.ldexp(_horner(_EXP, r), np.maximum(power, -1070.0).astype(np.int32))
    return np.where(values < _MIN_EXPONENT, 0.0, result)


def exp_minus_one(x: ArrayLike) -> NDArray[np.float64]:
    """Return e^x − 1 for `x` of any shape, at most 700, without cancellation near 0."""
    values = np.maximum(np.asarray(x, np.float64), _MIN_EXPONENT)
    if values.size <= _MAX_SCALAR_SIZE:  # the size of a live cycle: scalar operations take a tenth of the time
        return np.array([_exp_minus_one(value) for value in values.ravel().tolist()]).reshape(values.shape)
    power = np.rint(values * (1 / math.log(2)))
    r = (values - power * _LN2_HIGH) - power * _LN2_LOW
    scale = np.ldexp(1.0, power.astype(np.int32))
    result: NDArray[np.float64] = _horner(_EXP[1:], r)
    result *= r
    result *= scale
    result += scale - 1.0
    return result


def _exp_minus_one(value: float) -> float:
    """Return e^x − 1 of one number, with the same bits as exp_minus_one."""
    power = float(round(value * (1 / math.log(2))))
    r = (value - power * _LN2_HIGH) - power * _LN2_LOW
    scale = math.ldexp(1.0, int(power))
    result = _EXP[-1]
    for coefficient in _EXP[-2:0:-1]:
        result = result * r + coefficient
    return result * r * scale + (scale - 1.0)


def ln(x: ArrayLike) -> NDArray[np.float64]:
    """Return the natural logarithm of `x` > 0, of any shape."""
    mantissa, power = np.frexp(np.asarray(x, np.float64))
    is_low = mantissa < math.sqrt(0.5)
    mantissa, power = np.where(is_low, 2.0 * mantissa, mantissa), power - is_low
    s = (mantissa - 1.0) / (mantissa + 1.0)
    logarithm: NDArray[np.float64] = 2.0 * s * _horner(_ARTANH, s * s) + power * _LN2_LOW
    return logarithm + power * _LN2_HIGH


def power(base: ArrayLike, exponent: ArrayLike) -> NDArray[np.float64]:
    """Return `base` > 0 to the power of `exponent`; shapes are broadcast."""
    return exp(np.asarray(exponent, np.float64) * ln(base))


def sin_turns(turns: ArrayLike) -> NDArray[np.float64]:
    """Return the sine of 2π · `turns`, of any shape."""
    values = np.asarray(turns, np.float64)
    fraction = values - np.rint(values)  # -1/2 to 1/2
    fraction = np.where(fraction > 0.25, 0.5 - fraction, np.where(fraction < -0.25, -0.5 - fraction, fraction))
    angle = 2 * math.pi * fraction
    sine: NDArray[np.float64] = angle * _horner(_SIN, angle * angle)
    return sine


def interpolate(x: NDArray[np.float64], knots: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n,) values at `x` (n,), linear between the `knots` (k,) and constant beyond them.

    np.interp is C code, in which a compiler may fuse a product and a sum into one operation with other rounding.
    """
    after = np.minimum(np.maximum(np.searchsorted(knots, x, side="right"), 1), len(knots) - 1)
    before = np.maximum(after - 1, 0)
    gap = knots[after] - knots[before]
    share = np.clip(np.where(gap > 0, (x - knots[before]) / np.where(gap > 0, gap, 1.0), 1.0), 0.0, 1.0)
    line: NDArray[np.float64] = values[before] + share * (values[after] - values[before])
    return line


def weighted_sum(shares: NDArray[np.float64], patterns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, …) Σ_k shares[:, k] · patterns[k] for shares (n, k) and patterns (k, …), summed in a fixed order."""
    broadcast = (slice(None), *(None,) * (patterns.ndim - 1))
    total: NDArray[np.float64] = shares[:, 0][broadcast] * patterns[0]
    for k in range(1, len(patterns)):
        total += shares[:, k][broadcast] * patterns[k]
    return total


def _horner(coefficients: list[float], x: NDArray[np.float64]) -> NDArray[np.float64]:
    y = np.full_like(x, coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        y *= x
        y += coefficient
    return y
