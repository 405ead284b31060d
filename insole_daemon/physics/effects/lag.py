"""Lag: the reading follows the load with one time constant.

The live inverse estimates the load of residual_delay_s = √(τ · LATE_S) ago, at most τ ago, and leaves that delay to the
time stamp. Value and slope of q at that time, P = q + τ·dq/dt, are those of the parabola that fits the last READINGS
best (Savitzky & Golay, Anal. Chem. 36 (1964) 1627), as a sum of polynomials that are orthogonal at their times
(Forsythe, J. SIAM 5 (1957) 74). The slope at the newest reading is several times less certain than one cycle earlier; a
longer delay costs more than it gains (benchmarks/physics/compensation.py).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..first_order import recur, steps
from ..kernel_stage import KernelStage, StageKind
from ..law import Array, Law, Moments, Operator, Parameter, Site, Values

LATE_S = 0.008
READINGS = 5
_PERIOD_S = 0.02  # assumed period of the cycles before the first one; also the unit of time in the fit
_NO_CURVE = 1e-9  # regularisation for too few distinct times

_SAME_MOMENT = 1e-12  # below this weight of the new load, a step does not determine it


class _Lag:
    """Computes q from the load, with the exact step of `first_order`."""

    def __init__(self, tau_s: Array) -> None:
        self._tau_s = tau_s
        self._q: Array | None = None
        self._load: Array

    def __call__(self, x: Array, moments: Moments) -> Array:
        if self._q is None:
            self._q = self._load = x[0].copy()
        step = steps(moments.dt_s, self._tau_s)
        q = step.now * x
        q[0] += step.before[0] * self._load
        q[1:] += step.before[1:] * x[:-1]
        self._q, self._load = recur(step.decay, q, self._q), x[-1].copy()
        return q


class _Inverse:
    """Computes the load from q; the exact inverse of `_Lag`."""

    def __init__(self, tau_s: Array) -> None:
        self._tau_s = tau_s
        self._load: Array | None = None
        self._q: Array

    def __call__(self, x: Array, moments: Moments) -> Array:
        if self._load is None:
            self._load = self._q = x[0].copy()
        step = steps(moments.dt_s, self._tau_s)
        is_determined = step.now > _SAME_MOMENT
        now_weight = np.where(is_determined, step.now, 1.0)
        load = x.copy()
        load[0] -= step.decay[0] * self._q
        load[1:] -= step.decay[1:] * x[:-1]
        load *= is_determined / now_weight
        self._q = x[-1].copy()
        self._load = recur(np.where(is_determined, -step.before / now_weight, 1.0), load, self._load)
        return load


def _forward(values: Values, site: Site) -> Operator:
    return _Lag(values["tau_s"])


def _inverse(values: Values, site: Site) -> Operator:
    return _Inverse(values["tau_s"])


def _residual_delay_s(values: Values) -> Array:
    """Return (m,) or (1,) the delay that remains after the live inverse, in s."""
    delay_s: Array = np.minimum(values["tau_s"], np.sqrt(values["tau_s"] * LATE_S))
    return delay_s


class _Live:
    """Estimates q + τ·dq/dt as it was `delay_s` ago."""

    def __init__(self, tau_s: Array, delay_s: Array) -> None:
        tau, delay = tau_s / _PERIOD_S, delay_s / _PERIOD_S
        self._slope_factor, self._curvature_factor = tau - delay, delay * (delay - 2.0 * tau)
        self._t_s: Array | None = None  # (READINGS − 1,) times of the previous readings
        self._q: Array  # (READINGS − 1, m)

    def __call__(self, x: Array, moments: Moments) -> Array:
        if self._t_s is None:
            self._t_s = moments.t_s[0] - _PERIOD_S * np.arange(READINGS - 1, 0, -1)
            self._q = np.repeat(x[:1], READINGS - 1, axis=0)
        t_s, q = np.concatenate([self._t_s, moments.t_s]), np.concatenate([self._q, x])
        self._t_s, self._q = t_s[1 - READINGS :].copy(), q[1 - READINGS :].copy()
        rows = np.arange(len(x))[:, None] + np.arange(READINGS)
        t = (t_s[rows] - moments.t_s[:, None]) / _PERIOD_S
        mean = t.sum(axis=1, keepdims=True) / READINGS
        first = t - mean
        square = (first * first).sum(axis=1, keepdims=True) + _NO_CURVE
        skew, spread = (first * first * first).sum(axis=1, keepdims=True) / square, square / READINGS
        second = first * first - skew * first - spread
        norm = (second * second).sum(axis=1, keepdims=True) + _NO_CURVE
        # Value and slope of `second` at the newest reading; those of `first` are −mean and 1.
        now, slope_now = mean * mean + skew * mean - spread, -2.0 * mean - skew
        of_first = (self._slope_factor - mean) / square  # (n, 1 or m), as the next
        of_second = (now + self._slope_factor * slope_now + self._curvature_factor) / norm
        load: Array = np.zeros_like(x)
        for k in range(READINGS):
            load += (1.0 / READINGS + first[:, k : k + 1] * of_first + second[:, k : k + 1] * of_second) * q[
                k : k + len(x)
            ]
        return load

    def kernel_stage(self, columns: NDArray[np.intp]) -> KernelStage:
        """Return it as a stage on the slots `columns` (m,)."""
        factors = self._slope_factor, self._curvature_factor
        n_remembered = (READINGS - 1) * (len(columns) + 1)
        return KernelStage(StageKind.LAG, 1, columns, np.empty(0, np.int64), *factors, factors[1], n_remembered)


def _live(values: Values, site: Site) -> Operator:
    return _Live(values["tau_s"], _residual_delay_s(values))


LAW = Law(
    word="lag",
    order=6,
    domain="pressure",
    equation="τ·dq/dt = P − q",
    source="first-order low pass; exact step in first_order.py",
    parameters=(Parameter("tau_s", "s", 1e-4, 10.0, (0.005, 0.08), "time constant"),),
    forward=_forward,
    inverse=_inverse,
    inverse_is=(
        "exact for steps of τ/20000 and longer, and stable; but it differentiates, so smooth its input: at "
        "dt = τ it makes white noise 5 times as large, at dt = τ/2 14 times"
    ),
    live=_live,
    late_s=_residual_delay_s,
)
