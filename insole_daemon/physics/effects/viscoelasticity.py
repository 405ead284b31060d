"""Viscoelasticity: a standard linear solid; part of the deformation is immediate, the rest has one time constant."""

from __future__ import annotations

from ..law import MOST_SHARED, Law, Operator, Parameter, Site, Values
from ..relaxation import Relaxation


def _forward(values: Values, site: Site) -> Operator:
    return Relaxation(1.0 - values["a"], values["a"][None], values["tau_s"][None])


def _inverse(values: Values, site: Site) -> Operator:
    return Relaxation(1.0 - values["a"], values["a"][None], values["tau_s"][None], is_inverse=True)


LAW = Law(
    word="viscoelasticity",
    order=5,
    domain="pressure",
    equation="q = (1 − a)·P + a·z, τ·dz/dt = P − z",
    source="standard linear solid (Zener): its creep compliance 1 − a·exp(−t/τ), superposed after Boltzmann",
    parameters=(
        Parameter("a", "1", 0.0, MOST_SHARED, (0.03, 0.25), "delayed share of the response"),
        Parameter("tau_s", "s", 1e-4, 1e5, (0.05, 3.0), "time constant of that share"),
    ),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact",
)
