"""q = b·P + Σ a_k·z_k,  τ_k·dz_k/dt = P − z_k, and its inverse: what `viscoelasticity` and both creeps share.

Some of the answer comes at once (b > 0), so the inverse is causal and as exact as the forward law: with the step of
`first_order`, w_k = E_k·z_k,(n−1) + before_k·P_(n−1) is known before sample n, and

    P_n = (q_n − Σ a_k·w_k) / (b + Σ a_k·now_k),   z_k,n = w_k + now_k·P_n
"""

from __future__ import annotations

import numpy as np

from .first_order import recur, steps
from .law import Array, Moments


class Relaxation:
    """The forward law; `at_once` b (1) or (m), `a` and `tau_s` (k, 1) or (k, m).

    `settled`: the first load has been there for ever, else it comes with its sample.
    """

    def __init__(self, at_once: Array, a: Array, tau_s: Array, settled: bool = True) -> None:
        self._at_once, self._a, self._tau_s = at_once, a, tau_s
        self._settled = settled
        self._z: Array | None = None  # (k, m)
        self._load: Array

    def __call__(self, x: Array, moments: Moments) -> Array:
        """(n, m) q of the load `x`."""
        if self._z is None:
            self._load = x[0].copy()
            self._z = np.broadcast_to(self._load * self._settled, (len(self._a), x.shape[1]))
        step = steps(moments.dt_s, self._tau_s)
        z = step.now * x[:, None]
        z[0] += step.before[0] * self._load
        z[1:] += step.before[1:] * x[:-1, None]
        self._z = recur(step.decay, z, self._z)
        self._load = x[-1].copy()
        z *= self._a
        q: Array = z.sum(axis=1)
        q += self._at_once * x
        return q


class InverseRelaxation:
    """The load of what `Relaxation` gave; the arguments are its."""

    def __init__(self, at_once: Array, a: Array, tau_s: Array, settled: bool = True) -> None:
        self._at_once, self._a, self._tau_s = at_once, a, tau_s
        self._settled = settled
        self._known: Array | None = None  # (k, m) a_k · w_k
        self._load: Array
        self._now: Array  # of the step before

    def __call__(self, x: Array, moments: Moments) -> Array:
        """(n, m) load of the q `x`."""
        if self._known is None:
            self._load = np.zeros(x.shape[1])
            # What has settled is q itself, since then b + Σ a_k = 1.
            self._known = self._a * (x[0] * self._settled)
            self._now = np.zeros_like(self._tau_s)
        step = steps(moments.dt_s, self._tau_s)
        # a_k·w_k of the next sample = E·(a_k·w_k) + push·P of this one: z is never needed by itself.
        push = step.before
        push[0] += step.decay[0] * self._now
        push[1:] += step.decay[1:] * step.now[:-1]
        push = push * self._a
        share = 1.0 / (self._at_once + (self._a * step.now).sum(axis=1))
        load: Array = x * share
        product, known, total = np.empty_like(self._known), self._known, np.empty(x.shape[1])
        for decay, pushed, part, row in zip(step.decay, push, share, load, strict=True):
            known *= decay
            np.multiply(pushed, self._load, out=product)
            known += product
            np.add.reduce(known, axis=0, out=total)
            total *= part
            row -= total
            self._load = row
        self._load, self._now = self._load.copy(), step.now[-1].copy()
        return load
