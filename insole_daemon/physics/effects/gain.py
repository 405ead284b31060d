"""Gain: a sensitivity that differs from the calibrated one."""

from __future__ import annotations

from ..law import Law, Operator, Parameter, Site, Values


def _forward(values: Values, site: Site) -> Operator:
    return lambda x, moments: x * values["gain"]


def _inverse(values: Values, site: Site) -> Operator:
    return lambda x, moments: x / values["gain"]


LAW = Law(
    word="gain",
    order=7,
    domain="activation",
    equation="baseline − c ← gain·(baseline − c)",
    source="Sorrentino et al. 2020: the count is linear in the capacitance's change, whose factor may be another",
    parameters=(Parameter("gain", "1", 0.01, 100.0, (0.6, 1.7), "factor of the activation"),),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact",
)
