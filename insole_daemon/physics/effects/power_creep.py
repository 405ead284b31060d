"""Creep without a time of its own: the answer to a load that stays grows with a power of time, and never ends.

Its kernel t^n is a sum of modes, exactly so for infinitely many of them:

    t^n = n/Γ(1 − n) · ∫ (1 − exp(−t/τ))·τ^n d(ln τ),   0 < n < 1

by the trapezoidal rule over ln τ, _PER_DECADE modes a decade, whose error falls exponentially with their number; the
sum is made 1 at a second, which stands for the factor. The modes beyond either end of the grid are not cut off: of
the faster ones one mode and a share that comes at once have the same Σ a, Σ a·τ and Σ a·τ²; of the slower ones one
mode has the same Σ a/τ and Σ a/τ². From a millisecond after a leap of the load to SPAN_S it is t^n to 10⁻⁶ of
itself, and each mode is exact in discrete time.
"""

from __future__ import annotations

import math

import numpy as np

from ..law import MOST_SHARED, Array, Law, Operator, Parameter, Site, Values
from ..portable import exp, exp_minus_one, power
from ..relaxation import Relaxation

SPAN_S = 1e5  # how long after a change of the load the kernel is right: 28 hours
_PER_DECADE = 3
_SHORTEST, _LONGEST = -4, 7  # powers of ten, in seconds, where the grid ends


def kernel(exponent: Array) -> tuple[Array, Array, Array]:
    """at_once (m), a and τ (k, m), τ in s, with t^n = at_once + Σ a_k·(1 − exp(−t/τ_k)), t in s, of n (m,)."""
    spacing = math.log(10) / _PER_DECADE
    ln_tau = np.arange(_SHORTEST * _PER_DECADE, _LONGEST * _PER_DECADE + 1)[:, None] * spacing

    def beyond(end: float, step: float, order: int) -> Array:
        """(m,) Σ τ^(n + order) over the modes beyond the grid's `end`, each `step` from the one before."""
        ratio = exp((exponent + order) * step)
        return exp((exponent + order) * end) * ratio / (1.0 - ratio)

    faster = [beyond(ln_tau[0, 0], -spacing, order) for order in (0, 1, 2)]
    slower = [beyond(ln_tau[-1, 0], spacing, -order) for order in (1, 2)]
    fast_s, slow_s = faster[2] / faster[1], slower[0] / slower[1]
    fast, slow = faster[1] / fast_s, slower[0] * slow_s
    grid_s = np.broadcast_to(exp(ln_tau), (len(ln_tau), len(exponent)))
    tau_s = np.concatenate([fast_s[None], grid_s, slow_s[None]])
    a = np.concatenate([fast[None], exp(ln_tau * exponent), slow[None]])
    at_once = faster[0] - fast
    of_a_second = at_once - (a * exp_minus_one(-1.0 / tau_s)).sum(axis=0)
    return at_once / of_a_second, a / of_a_second, tau_s


def _modes(values: Values) -> tuple[Array, Array, Array]:
    """What `Relaxation` is made of."""
    share, exponent = values["a"], values["exponent"]
    at_once, a, tau_s = kernel(exponent)  # of one exponent the modes are everybody's, whatever their shares
    share_of_a_second = share * power(values["t0_s"], -exponent)
    return 1.0 - share + share_of_a_second * at_once, share_of_a_second * a, tau_s


def _forward(values: Values, site: Site) -> Operator:
    return Relaxation(*_modes(values), settled=False)


def _inverse(values: Values, site: Site) -> Operator:
    return Relaxation(*_modes(values), settled=False, back=True)


LAW = Law(
    word="power_creep",
    order=5,
    domain="pressure",
    equation="q = (1 − a)·P + a·∫ ((t − s)/t0)^n dP(s), without load before the first sample",
    source="fractional element (Scott Blair, J. Colloid Sci. 2 (1947) 21–32), superposed after Boltzmann",
    parameters=(
        Parameter("a", "1", 0.0, MOST_SHARED, (0.005, 0.15), "share of the answer that has come late, at t0"),
        Parameter("exponent", "1", 0.01, 0.9, (0.05, 0.4), "n of the time's power"),
        Parameter("t0_s", "s", 0.01, 1e5, (1.0, 1000.0), "after so long a hold the calibration is right"),
    ),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact",
)
