"""Creep: the response to a constant load continues to grow, over decades of time, and recovers as slowly.

With `scale_pa` a part flows as thermally activated processes do: the faster, the farther it is from equilibrium.
"""

from __future__ import annotations

import numpy as np

from ..activated_flow import ActivatedFlow
from ..law import MOST_SHARED, Array, Law, Operator, Parameter, Site, Values, sum_problem
from ..relaxation import Relaxation


def log_spaced_s(shortest_s: float, longest_s: float, k: int) -> Array:
    """Return (k,) logarithmically spaced time constants."""
    return np.geomspace(shortest_s, longest_s, k)


def _operator(values: Values, is_inverse: bool) -> Operator:
    a, tau_s, scale_pa = values["a"], values["tau_s"], values.get("scale_pa")
    if scale_pa is not None and scale_pa.any():
        return ActivatedFlow(a, tau_s, scale_pa, is_inverse=is_inverse)
    return Relaxation(1.0 - a.sum(axis=0), a, tau_s, is_inverse=is_inverse)


def _forward(values: Values, site: Site) -> Operator:
    return _operator(values, is_inverse=False)


def _inverse(values: Values, site: Site) -> Operator:
    return _operator(values, is_inverse=True)


LAW = Law(
    word="creep",
    order=5,
    domain="pressure",
    equation="q = (1 − Σ a_k)·P + Σ a_k·z_k, τ_k·dz_k/dt = P − z_k, or s_k·sinh((P − z_k)/s_k) with a scale s_k",
    source="Prony series of a generalised Kelvin chain, superposed after Boltzmann; activated flow after Eyring (1936)",
    parameters=(
        Parameter("a", "1", 0.0, MOST_SHARED, (0.005, 0.15), "delayed shares of the response", "list"),
        Parameter("tau_s", "s", 1e-4, 1e7, (0.5, 500.0), "time constants of those shares", "list"),
        Parameter(
            "scale_pa",
            "Pa",
            0.0,
            1e9,
            (5e3, 50e3),
            "pressures beyond which those shares flow exponentially faster; 0 or absent: never",
            "list",
            is_optional=True,
        ),
    ),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact",
    find_problem=lambda values: sum_problem("a", values),
)
