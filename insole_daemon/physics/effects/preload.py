"""Preload: constant pressure on the insole, for example from a strapped shoe."""

from __future__ import annotations

from ..law import Law, Operator, Parameter, Site, Values


def _forward(values: Values, site: Site) -> Operator:
    return lambda x, moments: x + values["p0_pa"]


def _inverse(values: Values, site: Site) -> Operator:
    return lambda x, moments: x - values["p0_pa"]


LAW = Law(
    word="preload",
    order=2,
    domain="pressure",
    equation="q = P + p0",
    source="Sorrentino et al. 2020, which masks it with a threshold of 30 counts",
    parameters=(Parameter("p0_pa", "Pa", -100_000.0, 500_000.0, (2_000.0, 20_000.0), "pressure of the strapped shoe"),),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact",
)
