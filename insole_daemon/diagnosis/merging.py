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
class RecordingFindings:
    """The findings of one recording, the effects that it cannot identify, and those without which it was read."""

    name: str  # of the recording
    load_is_known: bool
    findings: tuple[Finding, ...]
    cannot_tell: frozenset[str]
    undone: frozenset[str] = frozenset()


def merge_findings(by_recording: Sequence[RecordingFindings]) -> tuple[Finding, ...]:
    """Return findings in the order of their size; those of a known load first."""
    if len(by_recording) == 1:
        return tuple(sorted(by_recording[0].findings, key=lambda finding: -finding.size))
    known_load_first = sorted(by_recording, key=lambda recording: not recording.load_is_known)
    merged: list[Finding] = []
    for recording in known_load_first:
        for finding in sorted(recording.findings, key=lambda finding: -finding.size):
            if finding.effect not in LASTING:
                merged.append(finding)
            elif not _is_reported(finding, recording, merged):
                merged.append(_with_support(finding, recording, by_recording))
    return tuple(merged)


def _is_reported(finding: Finding, recording: RecordingFindings, merged: Sequence[Finding]) -> bool:
    """Return whether another recording already reported this effect; within one recording each place is a finding."""
    same = [other for other in merged if other.effect == finding.effect]
    return any(recording.name in other.recordings and other.recordings != (recording.name,) for other in same)


def _with_support(finding: Finding, recording: RecordingFindings, by_recording: Sequence[RecordingFindings]) -> Finding:
    """Return the finding with the recordings that also report it, and those that could and do not."""
    words_by_recording = {
        other.name: {reported.effect for reported in other.findings} | other.undone for other in by_recording
    }
    confirm = tuple(
        other.name for other in by_recording if other is recording or finding.effect in words_by_recording[other.name]
    )
    deny = tuple(
        other.name
        for other in by_recording
        if other.name not in confirm
        and finding.effect not in other.cannot_tell
        and "unknown" not in words_by_recording[other.name]
    )
    confidence = finding.confidence * (DENIED if deny else 1.0)
    return replace(finding, recordings=confirm, contradicted_by=deny, confidence=confidence)
