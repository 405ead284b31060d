"""Findings of several recordings of one insole as one list: what lasts is said once, with who confirms or denies it.

Where the load is known on every taxel, what a chamber can show is told from it: a walk sees the same through sums.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from .finding import Finding

# Of the insole and its material: there in every recording, or not at all.
LASTING = (
    "gain", "baseline", "stiffening", "bit_shift", "hysteresis", "viscoelasticity", "creep", "snap", "lag",
    "crosstalk", "map_transform", "swapped_triangles",
)  # fmt: skip
DENIED = 0.5  # times its confidence


@dataclass(frozen=True, slots=True)
class Said:
    """What one recording says, and which words it cannot tell."""

    recording: str
    load_is_known: bool
    findings: tuple[Finding, ...]
    cannot_tell: frozenset[str]


def merge_findings(every: Sequence[Said]) -> tuple[Finding, ...]:
    """Findings in the order of what they explain; those of a known load first."""
    if len(every) == 1:
        return tuple(sorted(every[0].findings, key=lambda each: -each.explains))
    chambers = sorted(every, key=lambda said: not said.load_is_known)
    found: list[Finding] = []
    for said in chambers:
        for each in sorted(said.findings, key=lambda each: -each.explains):
            if each.effect not in LASTING:
                found.append(each)
            elif not _is_told(each, said, found):
                found.append(_asked(each, said, every))
    return tuple(found)


def _is_told(each: Finding, said: Said, found: Sequence[Finding]) -> bool:
    """Whether another recording has told it; of one recording, the same word at another place is another finding."""
    same = [other for other in found if other.effect == each.effect]
    return any(said.recording in other.recordings and other.recordings != (said.recording,) for other in same)


def _asked(each: Finding, said: Said, every: Sequence[Said]) -> Finding:
    """With the recordings that say it, too, and those that could and do not."""
    names = {one.recording: {other.effect for other in one.findings} for one in every}
    confirm = tuple(one.recording for one in every if one is said or each.effect in names[one.recording])
    deny = tuple(
        one.recording for one in every
        if one.recording not in confirm and each.effect not in one.cannot_tell and "unknown" not in names[one.recording]
    )  # fmt: skip
    confidence = each.confidence * (DENIED if deny else 1.0)
    return replace(each, recordings=confirm, contradicted_by=deny, confidence=confidence)
