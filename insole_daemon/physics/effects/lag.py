"""A first-order lag: what arrives follows the load with one time constant.

Live it is undone only as far as pays: (1 + τ·s)/(1 + τ_f·s/2)². What is left are two lags of τ_f/2, of which all but
the second order is a delay of τ_f and stamped away as one; of a single lag of τ_f the second order would be twice as
large, and more of the noise would come through. τ_f = √(τ · ROLL_OFF_S), at most τ: with a count of noise more gain
makes a walk worse, with less noise it would pay (benchmarks/compensation.py).
"""

from __future__ import annotations

import numpy as np

from ..first_order import recur, steps
from ..law import Array, Law, Moments, Operator, Parameter, Site, Values
from ..relaxation import Relaxation

ROLL_OFF_S = 0.008

_SAME_MOMENT = 1e-12  # a step with less of the new load in it tells nothing about that load


class _Lag:
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
    def __init__(self, tau_s: Array) -> None:
        self._tau_s = tau_s
        self._load: Array | None = None
        self._q: Array

    def __call__(self, x: Array, moments: Moments) -> Array:
        if self._load is None:
            self._load = self._q = x[0].copy()
        step = steps(moments.dt_s, self._tau_s)
        known = step.now > _SAME_MOMENT
        now = np.where(known, step.now, 1.0)
        load = x.copy()
        load[0] -= step.decay[0] * self._q
        load[1:] -= step.decay[1:] * x[:-1]
        load *= known / now
        self._q = x[-1].copy()
        self._load = recur(np.where(known, -step.before / now, 1.0), load, self._load)
        return load


def _forward(values: Values, site: Site) -> Operator:
    return _Lag(values["tau_s"])


def _inverse(values: Values, site: Site) -> Operator:
    return _Inverse(values["tau_s"])


def _left_s(values: Values) -> Array:
    """(m,) or (1,) by how much it is late that is left."""
    left_s: Array = np.minimum(values["tau_s"], np.sqrt(values["tau_s"] * ROLL_OFF_S))
    return left_s


def _live(values: Values, site: Site) -> Operator:
    half_s = _left_s(values) / 2
    gain = values["tau_s"] / half_s
    lead = Relaxation(gain, 1.0 - gain[None], half_s[None])
    smooth = Relaxation(np.zeros(1), np.ones((1, 1)), half_s[None])
    return lambda x, moments: lead(smooth(x, moments), moments)


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
        "exact for steps of τ/20000 and longer, and stable; but it differentiates, so smooth what it is given: at "
        "dt = τ it makes white noise 5 times as large, at dt = τ/2 14 times"
    ),
    live=_live,
    late_s=_left_s,
)
