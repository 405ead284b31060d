"""Relaxation and its inverse, shared by `viscoelasticity` and both creeps.

    q = b·P + Σ a_k·z_k,  τ_k·dz_k/dt = P − z_k

With the step of `first_order`, w_k = E_k·z_k,(n−1) + before_k·P_(n−1) is known before sample n, and

    q_n = (b + Σ a_k·now_k)·P_n + Σ a_k·w_k,   z_k,n = w_k + now_k·P_n

Because a part of the response is immediate (b > 0), this can be solved for P_n: the inverse is causal and as exact as
the law. The next a_k·w_k = E_k·(a_k·w_k) + a_k·(before_k + E_k·now_k)·P_n, so z itself is never needed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .first_order import steps
from .kernel_stage import KernelStage, StageKind
from .law import Array, Moments


class Relaxation:
    """The law or its inverse; `at_once` b (1) or (m), `a` and `tau_s` (k, 1) or (k, m)."""

    def __init__(
        self, at_once: Array, a: Array, tau_s: Array, *, is_settled: bool = True, is_inverse: bool = False
    ) -> None:
        """Create the operator at its first sample.

        `is_settled`: the first load is assumed to have lasted for ever, else to begin with the first sample.
        `is_inverse` selects the inverse.
        """
        self._at_once, self._a, self._tau_s = at_once, a, tau_s
        self._is_settled, self._is_inverse = is_settled, is_inverse
        self._known: Array | None = None  # (k, m) a_k · w_k
        self._load: Array
        self._previous_now: Array  # of the previous step

    def __call__(self, x: Array, moments: Moments) -> Array:
        """Return (n, m) q for the load `x`, or the load for q."""
        if self._known is None:
            self._load = np.zeros(x.shape[1])
            # For a settled load q equals the load, since b + Σ a_k = 1.
            self._known = self._a * (x[0] * self._is_settled)
            self._previous_now = np.zeros_like(self._tau_s)
        step = steps(moments.dt_s, self._tau_s)
        push = step.before
        push[0] += step.decay[0] * self._previous_now
        push[1:] += step.decay[1:] * step.now[:-1]
        push = push * self._a
        immediate_share = self._at_once + np.add.accumulate(self._a * step.now, axis=1)[:, -1]
        result: Array = x / immediate_share if self._is_inverse else x * immediate_share
        load, known, product, total = self._load, self._known, np.empty_like(self._known), np.empty(x.shape[1])
        for decay, pushed, immediate, row, output in zip(step.decay, push, immediate_share, x, result, strict=True):
            known *= decay
            np.multiply(pushed, load, out=product)
            known += product
            np.add.reduce(known, axis=0, out=total)
            if self._is_inverse:
                total /= immediate
                output -= total
                load = output
            else:
                output += total
                load = row
        self._load, self._previous_now = load.copy(), step.now[-1].copy()
        return result

    def kernel_stage(self, columns: NDArray[np.intp]) -> KernelStage:
        """Return the inverse as a stage on the slots `columns` (m,)."""
        assert self._is_inverse, "the kernel has only the inverse"
        k, m = len(self._tau_s), len(columns)
        kind = StageKind.RELAXATION if self._is_settled else StageKind.RELAXATION_FROM_REST
        return KernelStage(
            kind, k, columns, np.empty(0, np.int64), self._at_once, self._a, self._tau_s, k * m + m + self._tau_s.size
        )
