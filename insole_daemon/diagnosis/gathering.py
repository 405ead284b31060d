"""Findings of one recording that are one effect at several places, as one finding.

A material that snaps has its thresholds in every triangle, and a memory is stronger at one place than at another: the
search tells them apart, and whoever reads the findings wants the effect and where it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..skin.geometry import N_TAXELS
from .finding import Finding, Quantity
from .model.placement import place_of
from .observations.wrench import WrenchObservation
from .places import said

# What says how strong it is; of snaps every place has a strength of its own.
STRENGTHS: dict[str, Callable[[Finding], float]] = {
    "gain": lambda each: float(each.parameters["gain"].value) - 1.0,
    "baseline": lambda each: float(each.parameters["shift_count"].value),
    "viscoelasticity": lambda each: float(each.parameters["a"].value),
    "creep": lambda each: float(np.sum(each.parameters["a"].value)),
    "hysteresis": lambda each: float(np.sum(each.parameters["w"].value)),
    "snap": lambda each: 1.0,
}
MOST_APART = 2.5  # times as strong


def join_places(findings: Sequence[Finding], seen: WrenchObservation) -> tuple[Finding, ...]:
    """Each word once for all places where it is about as strong; what is left over as it was."""
    found: list[Finding] = []
    for each in sorted(findings, key=lambda each: -each.explains):
        like = next((i for i, other in enumerate(found) if _is_same(other, each)), None)
        if like is None:
            found.append(each)
        else:
            found[like] = _joined(found[like], each, seen)
    return tuple(found)


def _is_same(one: Finding, other: Finding) -> bool:
    if one.effect != other.effect or one.effect not in STRENGTHS or one.parameters.keys() != other.parameters.keys():
        return False
    if one.where.scope == "taxel" or other.where.scope == "taxel":
        return False
    strengths = STRENGTHS[one.effect](one), STRENGTHS[one.effect](other)
    ratio = strengths[1] / strengths[0] if strengths[0] else 0.0
    return 1.0 / MOST_APART <= ratio <= MOST_APART


def _joined(strongest: Finding, other: Finding, seen: WrenchObservation) -> Finding:
    """At both places; parameters of the one that explains most, as far off as the other's are."""
    rows = np.zeros(len(seen.layout), bool)
    for each in (strongest, other):
        rows[each.where.slots(seen.layout) // N_TAXELS] = True
    where = place_of(rows, seen)
    parameters = {name: _wider(own, other.parameters[name]) for name, own in strongest.parameters.items()}
    _, text = strongest.sentence.split(": ", 1)
    return replace(
        strongest, where=where, parameters=parameters, explains=strongest.explains + other.explains,
        sentence=f"{said(where)}: {text}",
    )  # fmt: skip


def _wider(own: Quantity, other: Quantity) -> Quantity:
    if np.ndim(own.value) or np.ndim(other.value) or np.ndim(own.std):
        return own
    return replace(own, std=max(float(own.std), abs(float(own.value) - float(other.value))))
