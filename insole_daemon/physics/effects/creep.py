"""Creep: the response to a constant load continues to grow, over decades of time, and recovers as slowly."""

from __future__ import annotations

import numpy as np

from ..law import MOST_SHARED, Array, Law, Operator, Parameter, Site, Values, sum_problem
from ..relaxation import Relaxation


def log_spaced_s(shortest_s: float, longest_s: float, k: int) -> Array:
    """Return (k,) logarithmically spaced time constants."""
    return np.geomspace(shortest_s, longest_s, k)


def _forward(values: Values, site: Site) -> Operator:
    return Relaxation(1.0 - values["a"].sum(axis=0), values["a"], values["tau_s"])


def _inverse(values: Values, site: Site) -> Operator:
    return Relaxation(1.0 - values["a"].sum(axis=0), values["a"], values["tau_s"], is_inverse=True)


LAW = Law(
    word="creep",
    order=5,
    domain="pressure",
    equation="q = (1 − Σ a_k)·P + Σ a_k·z_k, τ_k·dz_k/dt = P − z_k",
    source="Prony series of a generalised Kelvin chain, superposed after Boltzmann",
    parameters=(
        Parameter("a", "1", 0.0, MOST_SHARED, (0.005, 0.15), "delayed shares of the response", "list"),
        Parameter("tau_s", "s", 1e-4, 1e7, (0.5, 500.0), "time constants of those shares", "list"),
    ),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact",
    find_problem=lambda values: sum_problem("a", values),
)
