"""Merge the findings of several recordings of one insole into one list.

A lasting effect is reported once, with the recordings that confirm or contradict it. A chamber, in which the load of
every taxel is known, takes precedence over a walk, in which only sums are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from .finding import Finding

# Properties of the insole and its material, which are present in every recording or in none.
LASTING = (
    "gain", "baseline", "stiffening", "bit_shift", "hysteresis", "viscoelasticity", "creep", "snap", "lag",
    "crosstalk", "map_transform", "swapped_triangles",
)  # fmt: skip
DENIED = 0.5  # factor on the confidence of a contradicted finding


@dataclass(frozen=True, slots=True)
class Said:
    """The findings of one recording, and the words that it cannot identify."""

    recording: str
    load_is_known: bool
    findings: tuple[Finding, ...]
    cannot_tell: frozenset[str]


def merge_findings(by_recording: Sequence[Said]) -> tuple[Finding, ...]:
    """Return findings in the order of their size; those of a known load first."""
    if len(by_recording) == 1:
        return tuple(sorted(by_recording[0].findings, key=lambda finding: -finding.size))
    chambers = sorted(by_recording, key=lambda account: not account.load_is_known)
    merged: list[Finding] = []
    for account in chambers:
        for finding in sorted(account.findings, key=lambda finding: -finding.size):
            if finding.effect not in LASTING:
                merged.append(finding)
            elif not _is_reported(finding, account, merged):
                merged.append(_with_support(finding, account, by_recording))
    return tuple(merged)


def _is_reported(finding: Finding, account: Said, merged: Sequence[Finding]) -> bool:
    """Return whether another recording already reported this effect; within one recording each place is a finding."""
    same = [other for other in merged if other.effect == finding.effect]
    return any(account.recording in other.recordings and other.recordings != (account.recording,) for other in same)


def _with_support(finding: Finding, account: Said, by_recording: Sequence[Said]) -> Finding:
    """Return the finding with the recordings that also report it, and those that could and do not."""
    names = {other.recording: {reported.effect for reported in other.findings} for other in by_recording}
    confirm = tuple(
        other.recording for other in by_recording if other is account or finding.effect in names[other.recording]
    )
    deny = tuple(
        other.recording
        for other in by_recording
        if other.recording not in confirm
        and finding.effect not in other.cannot_tell
        and "unknown" not in names[other.recording]
    )
    confidence = finding.confidence * (DENIED if deny else 1.0)
    return replace(finding, recordings=confirm, contradicted_by=deny, confidence=confidence)
