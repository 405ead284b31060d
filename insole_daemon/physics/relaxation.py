"""q = b·P + Σ a_k·z_k,  τ_k·dz_k/dt = P − z_k, and its inverse: what `viscoelasticity` and both creeps share.

With the step of `first_order`, w_k = E_k·z_k,(n−1) + before_k·P_(n−1) is known before sample n, and

    q_n = (b + Σ a_k·now_k)·P_n + Σ a_k·w_k,   z_k,n = w_k + now_k·P_n

Some of the answer comes at once (b > 0), so this can be solved for P_n: the inverse is causal and as exact as the law.
The next a_k·w_k = E_k·(a_k·w_k) + a_k·(before_k + E_k·now_k)·P_n, so z is never needed by itself.
"""

from __future__ import annotations

import numpy as np

from .first_order import steps
from .law import Array, Moments


class Relaxation:
    """The law or its inverse; `at_once` b (1) or (m), `a` and `tau_s` (k, 1) or (k, m)."""

    def __init__(self, at_once: Array, a: Array, tau_s: Array, *, settled: bool = True, back: bool = False) -> None:
        """`settled`: the first load has been there for ever, else it comes with its sample; `back`: the inverse."""
        self._at_once, self._a, self._tau_s = at_once, a, tau_s
        self._settled, self._back = settled, back
        self._known: Array | None = None  # (k, m) a_k · w_k
        self._load: Array
        self._now: Array  # of the step before

    def __call__(self, x: Array, moments: Moments) -> Array:
        """(n, m) q of the load `x`, or load of the q."""
        if self._known is None:
            self._load = np.zeros(x.shape[1])
            # A load that has settled is q itself, since then b + Σ a_k = 1.
            self._known = self._a * (x[0] * self._settled)
            self._now = np.zeros_like(self._tau_s)
        step = steps(moments.dt_s, self._tau_s)
        push = step.before
        push[0] += step.decay[0] * self._now
        push[1:] += step.decay[1:] * step.now[:-1]
        push = push * self._a
        share = self._at_once + (self._a * step.now).sum(axis=1)
        result: Array = x / share if self._back else x * share
        load, known, product, total = self._load, self._known, np.empty_like(self._known), np.empty(x.shape[1])
        for decay, pushed, part, row, found in zip(step.decay, push, share, x, result, strict=True):
            known *= decay
            np.multiply(pushed, load, out=product)
            known += product
            np.add.reduce(known, axis=0, out=total)
            if self._back:
                total /= part
                found -= total
                load = found
            else:
                found += total
                load = row
        self._load, self._now = load.copy(), step.now[-1].copy()
        return result
