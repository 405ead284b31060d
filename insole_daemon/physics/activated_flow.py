"""Thermally activated flow and its inverse: a creep that is the faster, the farther it is from equilibrium.

    q = P − Σ a_k·l_k,  l_k = P − z_k,  τ_k·dz_k/dt = s_k·sinh(l_k/s_k), or l_k where the scale s_k is 0

Over a step Δt with constant P, tanh(l/2s) decays with exp(−Δt/τ). Half of a change of the load enters before this and
half after it, which is exact to the second order of the step. The inverse solves the same equation for P by Newton's
method: its derivative is at least the immediate share 1 − Σ a_k.

Source: H. Eyring, J. Chem. Phys. 4 (1936) 283; the splitting: G. Strang, SIAM J. Numer. Anal. 5 (1968) 506.
"""

from __future__ import annotations

import numpy as np

from .law import Array, Moments
from .portable import exp, exp_minus_one, ln

MOST_STEPS = 30  # of Newton's method
SOLVED_PA = 1e-6  # remaining error of q
LARGEST = 600.0  # of l/s; the hyperbolic tangent is 1 beyond it


class ActivatedFlow:
    """The law or its inverse; `a`, `tau_s` and `scale_pa` (k, 1) or (k, m)."""

    def __init__(self, a: Array, tau_s: Array, scale_pa: Array, *, is_inverse: bool = False) -> None:
        """Create the operator at its first sample, whose load is assumed to have lasted for ever."""
        self._a, self._tau_s, self._scale_pa = a, tau_s, scale_pa
        self._is_inverse = is_inverse
        self._late: Array | None = None  # (k, m)
        self._load: Array

    def __call__(self, x: Array, moments: Moments) -> Array:
        """Return (n, m) q for the load `x`, or the load for q."""
        if self._late is None:
            self._late = np.zeros((len(self._a), x.shape[1]))
            self._load = x[0].copy()  # without lateness, q equals the load
        result = np.empty_like(x)
        for row, dt_s, output in zip(x, moments.dt_s, result, strict=True):
            decay = exp(-dt_s / self._tau_s)
            change = self._solved(row, decay) if self._is_inverse else row - self._load
            load = self._load + change
            self._late, _ = self._after(change, decay)
            self._load = load
            output[:] = load if self._is_inverse else load - (self._a * self._late).sum(axis=0)
        return result

    def _after(self, change: Array, decay: Array) -> tuple[Array, Array]:
        """Return l_k after a step with a change of the load, and its derivative by the change, (k, m) each."""
        assert self._late is not None
        late = self._late + 0.5 * change
        is_activated = (self._scale_pa > 0) & (decay < 1.0)  # within no time nothing flows
        scale = np.where(is_activated, self._scale_pa, 1.0)
        grown = exp_minus_one(np.clip(late / scale, -LARGEST, LARGEST))
        before = grown / (grown + 2.0)  # tanh(l/2s)
        after = np.where(is_activated, decay, 0.0) * before
        flowed = scale * ln((1.0 + after) / (1.0 - after))
        slope = decay * (1.0 - before**2) / (1.0 - after**2)
        flowed, slope = np.where(is_activated, flowed, decay * late), np.where(is_activated, slope, decay)
        return flowed + 0.5 * change, 0.5 * (slope + 1.0)

    def _solved(self, q: Array, decay: Array) -> Array:
        """Return the change (m,) of the load after which the law gives `q` (m,)."""
        change = np.zeros_like(q)
        for _ in range(MOST_STEPS):
            late, slope = self._after(change, decay)
            error = self._load + change - (self._a * late).sum(axis=0) - q
            if not np.abs(error).max(initial=0.0) > SOLVED_PA:
                break
            change -= error / (1.0 - (self._a * slope).sum(axis=0))
        return change
