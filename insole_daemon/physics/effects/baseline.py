"""Baseline: a constant shift of the unloaded count from the calibrated one."""

from __future__ import annotations

from ..law import Law, Operator, Parameter, Site, Values


def _forward(values: Values, site: Site) -> Operator:
    return lambda x, moments: x - values["shift_count"]


def _inverse(values: Values, site: Site) -> Operator:
    return lambda x, moments: x + values["shift_count"]


LAW = Law(
    word="baseline",
    order=8,
    domain="activation",
    equation="c ← c + shift",
    source="icub-firmware: the baseline is one single reading, taken whenever a board is configured",
    parameters=(Parameter("shift_count", "count", -255.0, 255.0, (-10.0, 10.0), "shift of every count"),),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact",
)
