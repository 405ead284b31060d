"""Findings on faults that readings or the reference show by themselves."""

from __future__ import annotations

from collections.abc import Sequence

from ...physics.effect import Where
from ..finding import Finding
from ..places import place_in_words
from .wrench import WrenchObservation

JOINED_S = 1.0  # gap between two times that are reported as one


def make_fault_finding(
    seen: WrenchObservation, effect: str, where: Where, when_s: Sequence[tuple[float, float]], text: str
) -> Finding:
    """Return a finding of an effect without parameters, with `text` on its place."""
    return Finding(
        effect=effect, foot=seen.layout.foot, where=where, sentence=f"{place_in_words(where)}: {text}.",
        recordings=(seen.name,), when_s=tuple(when_s),
    )  # fmt: skip
