"""Power-law creep: the response to a constant load grows with a power of time, without a characteristic time or end.

The kernel t^n is a sum of exponential modes, exactly so for infinitely many:

    t^n = n/Γ(1 − n) · ∫ (1 − exp(−t/τ))·τ^n d(ln τ),   0 < n < 1

The integral is computed by the trapezoidal rule over ln τ with _PER_DECADE modes per decade, whose error decreases
exponentially with their number; the sum is normalised to 1 at one second, which replaces the factor. The modes beyond
the ends of the grid are not dropped: one mode and an immediate share have the same Σ a, Σ a·τ and Σ a·τ² as the faster
ones, and one mode has the same Σ a/τ and Σ a/τ² as the slower ones. From a millisecond to SPAN_S after a step of the
load the relative error is 10⁻⁶, and each mode is exact in discrete time.
"""

from __future__ import annotations

import math

import numpy as np

from ..law import MOST_SHARED, Array, Law, Operator, Parameter, Site, Values
from ..portable import exp, exp_minus_one, power
from ..relaxation import Relaxation

SPAN_S = 1e5  # time after a change of the load up to which the kernel is accurate: 28 hours
_PER_DECADE = 3
_SHORTEST, _LONGEST = -4, 7  # ends of the grid, as powers of ten of a second


def kernel(exponent: Array) -> tuple[Array, Array, Array]:
    """Return the modes of t^n = at_once + Σ a_k·(1 − exp(−t/τ_k)), t in s, for exponents n (m,).

    These are at_once (m,), a and τ (k, m), with τ in s.
    """
    spacing = math.log(10) / _PER_DECADE
    ln_tau = np.arange(_SHORTEST * _PER_DECADE, _LONGEST * _PER_DECADE + 1)[:, None] * spacing

    def beyond(end: float, step: float, order: int) -> Array:
        """Return (m,) Σ τ^(n + order) over the modes beyond the grid's `end`, at intervals of `step`."""
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
    at_one_second = at_once - (a * exp_minus_one(-1.0 / tau_s)).sum(axis=0)
    return at_once / at_one_second, a / at_one_second, tau_s


def _modes(values: Values) -> tuple[Array, Array, Array]:
    """Return the arguments of `Relaxation`."""
    share, exponent = values["a"], values["exponent"]
    at_once, a, tau_s = kernel(exponent)  # with one exponent, all taxels share the modes, whatever their shares
    share_at_one_second = share * power(values["t0_s"], -exponent)
    return 1.0 - share + share_at_one_second * at_once, share_at_one_second * a, tau_s


def _forward(values: Values, site: Site) -> Operator:
    return Relaxation(*_modes(values), is_settled=False)


def _inverse(values: Values, site: Site) -> Operator:
    return Relaxation(*_modes(values), is_settled=False, is_inverse=True)


LAW = Law(
    word="power_creep",
    order=5,
    domain="pressure",
    equation="q = (1 − a)·P + a·∫ ((t − s)/t0)^n dP(s), without load before the first sample",
    source="fractional element (Scott Blair, J. Colloid Sci. 2 (1947) 21–32), superposed after Boltzmann",
    parameters=(
        Parameter("a", "1", 0.0, MOST_SHARED, (0.005, 0.15), "delayed share of the response at t0"),
        Parameter("exponent", "1", 0.01, 0.9, (0.05, 0.4), "n, the exponent of time"),
        Parameter("t0_s", "s", 0.01, 1e5, (1.0, 1000.0), "duration of a hold after which the calibration is accurate"),
    ),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact",
)
