"""Creep: the answer to a load that stays goes on growing, over decades of time, and comes back as slowly."""

from __future__ import annotations

import math

import numpy as np

from ..law import MOST_SHARED, Array, Law, Operator, Parameter, Site, Values, wrong_sum
from ..relaxation import InverseRelaxation, Relaxation

_PER_DECADE = 4  # time constants of a power law
_BEYOND = 10  # so many times before and after the law's ends its modes still shape it


def log_spaced_s(shortest_s: float, longest_s: float, k: int) -> Array:
    """(k,) time constants, each the same factor longer than the one before."""
    return np.geomspace(shortest_s, longest_s, k)


def power_law(share: float, exponent: float, shortest_s: float, longest_s: float) -> tuple[Array, Array]:
    """(a, tau_s) of a creep that grows as share · (t/longest_s)^exponent from shortest_s to longest_s.

    t^n = n/Γ(1 − n) · ∫ (1 − exp(−t/τ))·τ^(n−1) dτ for 0 < n < 1, by the trapezoidal rule over ln τ. It is realised
    from its value at `shortest_s` on, to 0.2 % of its growth for an exponent up to 1/2, to 1.3 % at 0.8: what relaxes
    within a tenth of `shortest_s` is left to the share that comes at once. Modes that have not run down at
    `longest_s` have a part in it, so the sum of `a` is more than what is grown by then.
    """
    if not 0 < exponent < 1:
        raise ValueError(f"expected an exponent between 0 and 1, found {exponent:g}")
    spacing = math.log(10) / _PER_DECADE
    last_s = _BEYOND * longest_s
    tau_s = np.exp(np.arange(math.log(shortest_s / _BEYOND), math.log(last_s), spacing))
    a = share * exponent / math.gamma(1 - exponent) * (tau_s / longest_s) ** exponent * spacing
    # Of all modes that are longer still no more is seen than how fast they begin, ∫ a/τ: one stands for them. It
    # begins half a step behind the last, where the trapezoidal rule has ended.
    end_s = tau_s[-1] * math.exp(spacing / 2)
    slope = share * exponent / math.gamma(1 - exponent) / longest_s * (end_s / longest_s) ** (exponent - 1)
    return np.append(a, slope / (1 - exponent) * 2 * end_s), np.append(tau_s, 2 * end_s)


def _forward(values: Values, site: Site) -> Operator:
    return Relaxation(values["a"], values["tau_s"])


def _inverse(values: Values, site: Site) -> Operator:
    return InverseRelaxation(values["a"], values["tau_s"])


LAW = Law(
    word="creep",
    order=5,
    domain="pressure",
    equation="q = (1 − Σ a_k)·P + Σ a_k·z_k, τ_k·dz_k/dt = P − z_k",
    source="Prony series of a generalised Kelvin chain, superposed after Boltzmann; a power law by its spectrum",
    parameters=(
        Parameter("a", "1", 0.0, MOST_SHARED, (0.005, 0.15), "shares of the answer that come late", "list"),
        Parameter("tau_s", "s", 1e-4, 1e7, (0.5, 500.0), "time constants of those shares", "list"),
    ),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact",
    wrong=lambda values: wrong_sum("a", values),
)
