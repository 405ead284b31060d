"""Join findings of one recording that are one effect at several places.

A material that snaps has its own thresholds in every triangle, and a memory varies in strength across the insole. The
search finds these as separate effects; the reader needs the effect and all its places.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..skin.geometry import N_TAXELS
from .finding import Finding, Quantity
from .model.placement import place_of
from .observations.wrench import WrenchObservation
from .places import place_in_words

# The strength of a finding by word; a snap may have any strength at each place.
STRENGTHS: dict[str, Callable[[Finding], float]] = {
    "gain": lambda finding: float(finding.parameters["gain"].value) - 1.0,
    "baseline": lambda finding: float(finding.parameters["shift_count"].value),
    "viscoelasticity": lambda finding: float(finding.parameters["a"].value),
    "creep": lambda finding: float(np.sum(finding.parameters["a"].value)),
    "hysteresis": lambda finding: float(np.sum(finding.parameters["w"].value)),
    "snap": lambda finding: 1.0,
}
MOST_APART = 2.5  # largest ratio of strengths that are joined


def join_places(findings: Sequence[Finding], seen: WrenchObservation) -> tuple[Finding, ...]:
    """Join findings of one word with similar strength; return these and the others unchanged."""
    joined: list[Finding] = []
    for finding in sorted(findings, key=lambda finding: -finding.size):
        like = next((i for i, other in enumerate(joined) if _is_same(other, finding)), None)
        if like is None:
            joined.append(finding)
        else:
            joined[like] = _joined(joined[like], finding, seen)
    return tuple(joined)


def _is_same(one: Finding, other: Finding) -> bool:
    if one.effect != other.effect or one.effect not in STRENGTHS or one.parameters.keys() != other.parameters.keys():
        return False
    if one.where.scope == "taxel" or other.where.scope == "taxel":
        return False
    strengths = STRENGTHS[one.effect](one), STRENGTHS[one.effect](other)
    ratio = strengths[1] / strengths[0] if strengths[0] else 0.0
    return 1.0 / MOST_APART <= ratio <= MOST_APART


def _joined(strongest: Finding, other: Finding, seen: WrenchObservation) -> Finding:
    """Return a finding at both places, with the parameters of `strongest` and a std that covers those of `other`."""
    rows = np.zeros(len(seen.layout), bool)
    for finding in (strongest, other):
        rows[finding.where.slots(seen.layout) // N_TAXELS] = True
    where = place_of(rows, seen)
    parameters = {name: _wider(quantity, other.parameters[name]) for name, quantity in strongest.parameters.items()}
    _, text = strongest.sentence.split(": ", 1)
    return replace(
        strongest, where=where, parameters=parameters, explains=strongest.explains + other.explains,
        sentence=f"{place_in_words(where)}: {text}",
    )  # fmt: skip


def _wider(quantity: Quantity, other: Quantity) -> Quantity:
    if np.ndim(quantity.value) or np.ndim(other.value) or np.ndim(quantity.std):
        return quantity
    return replace(quantity, std=max(float(quantity.std), abs(float(quantity.value) - float(other.value))))
