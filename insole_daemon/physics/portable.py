"""exp, ln and sin out of additions, multiplications and divisions alone: the same bits on every machine.

numpy's own differ in the last bit with the vector unit of the CPU and the C library, BLAS in the order of its sums.
Here only operations are used that IEEE 754 rounds exactly, so that a simulated reading is the same everywhere; the
error is below 3e-16 of the result (of 1 for the sine; below 1e-15 for what is e^x − 1, or a power).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # their sum is ln 2 to 2^-86
_EXP = [1 / math.factorial(k) for k in range(14)]  # of r up to ln 2 / 2
_ARTANH = [1 / (2 * k + 1) for k in range(12)]  # of squares up to 0.03
_SIN = [(-1) ** k / math.factorial(2 * k + 1) for k in range(11)]  # of angles up to π / 2
_FEW = 16
_LEAST = -700.0  # below that, exp is 0 for us


def exp(x: ArrayLike) -> NDArray[np.float64]:
    """e to the power of `x`, of any shape, at most 700."""
    values = np.asarray(x, np.float64)
    power = np.rint(values * (1 / math.log(2)))
    r = (values - power * _LN2_HIGH) - power * _LN2_LOW
    result: NDArray[np.float64] = np.ldexp(_horner(_EXP, r), np.maximum(power, -1070.0).astype(np.int32))
    return np.where(values < _LEAST, 0.0, result)


def exp_minus_one(x: ArrayLike) -> NDArray[np.float64]:
    """e^x − 1 of `x`, of any shape, at most 700, without what a difference near 0 would lose."""
    values = np.maximum(np.asarray(x, np.float64), _LEAST)
    if values.size <= _FEW:  # as in every live cycle: the same operations one by one take a tenth of the time
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
    """The same of one number, with the same bits."""
    power = float(round(value * (1 / math.log(2))))
    r = (value - power * _LN2_HIGH) - power * _LN2_LOW
    scale = math.ldexp(1.0, int(power))
    result = _EXP[-1]
    for coefficient in _EXP[-2:0:-1]:
        result = result * r + coefficient
    return result * r * scale + (scale - 1.0)


def ln(x: ArrayLike) -> NDArray[np.float64]:
    """The natural logarithm of `x`, of any shape, above 0."""
    part, power = np.frexp(np.asarray(x, np.float64))
    low = part < math.sqrt(0.5)
    part, power = np.where(low, 2.0 * part, part), power - low
    s = (part - 1.0) / (part + 1.0)
    logarithm: NDArray[np.float64] = 2.0 * s * _horner(_ARTANH, s * s) + power * _LN2_LOW
    return logarithm + power * _LN2_HIGH


def power(base: ArrayLike, exponent: ArrayLike) -> NDArray[np.float64]:
    """`base`, above 0, to the `exponent`; any shapes that broadcast."""
    return exp(np.asarray(exponent, np.float64) * ln(base))


def sin_turns(turns: ArrayLike) -> NDArray[np.float64]:
    """The sine of 2π · `turns`, of any shape."""
    values = np.asarray(turns, np.float64)
    part = values - np.rint(values)  # -1/2 to 1/2
    part = np.where(part > 0.25, 0.5 - part, np.where(part < -0.25, -0.5 - part, part))
    angle = 2 * math.pi * part
    sine: NDArray[np.float64] = angle * _horner(_SIN, angle * angle)
    return sine


def between(x: NDArray[np.float64], knots: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) of `x` (n,): linear between the `knots` (k,), constant beyond them.

    np.interp is C, in which a compiler may join a product and a sum to one operation.
    """
    after = np.minimum(np.maximum(np.searchsorted(knots, x, side="right"), 1), len(knots) - 1)
    before = np.maximum(after - 1, 0)
    gap = knots[after] - knots[before]
    share = np.clip(np.where(gap > 0, (x - knots[before]) / np.where(gap > 0, gap, 1.0), 1.0), 0.0, 1.0)
    line: NDArray[np.float64] = values[before] + share * (values[after] - values[before])
    return line


def weighted(shares: NDArray[np.float64], patterns: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, …) Σ_k shares[:, k] · patterns[k], of shares (n, k) and patterns (k, …), always summed in this order."""
    wide = (slice(None), *(None,) * (patterns.ndim - 1))
    total: NDArray[np.float64] = shares[:, 0][wide] * patterns[0]
    for k in range(1, len(patterns)):
        total += shares[:, k][wide] * patterns[k]
    return total


def _horner(coefficients: list[float], x: NDArray[np.float64]) -> NDArray[np.float64]:
    y = np.full_like(x, coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        y *= x
        y += coefficient
    return y
