"""What every diagnosis comes to, whatever was known of the load: the content of `insole-diagnosis/1`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from ..physics.law import Array
from .finding import Finding, Verdict


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Outcome:
    """All that is said; `document` is its form as a file."""

    recordings: tuple[str, ...]
    against: Literal["model", "simulation"]
    verdict: Verdict
    heldout: Mapping[str, Any]  # unit, before, after, floor
    clocks: Array  # (recordings, 2) offset_s and rate of the reference's clock
    findings: tuple[Finding, ...]
    rejected: tuple[Mapping[str, str], ...]
    not_identifiable: tuple[Mapping[str, str], ...]
    model: Mapping[str, Any]

    def document(self) -> dict[str, Any]:
        """As `insole-diagnosis/1` has it."""
        return {
            "format": "insole-diagnosis/1",
            "recordings": list(self.recordings),
            "against": self.against,
            "verdict": self.verdict,
            "heldout": dict(self.heldout),
            "alignment": [
                {"recording": name, "offset_s": round(offset, 5), "rate": round(rate, 8)}
                for name, (offset, rate) in zip(self.recordings, self.clocks.tolist(), strict=True)
            ],
            "findings": [each.document() for each in self.findings],
            "rejected": [dict(each) for each in self.rejected],
            "not_identifiable": [dict(each) for each in self.not_identifiable],
        }


def verdict(findings: tuple[Finding, ...] | list[Finding]) -> Verdict:
    """What the findings come to in a word or two."""
    if not findings:
        return "no mismatch"
    unknown = [each for each in findings if each.effect == "unknown"]
    if unknown:
        return "unexplained" if len(unknown) == len(findings) else "partly explained"
    if any(len(each.alternatives) > 1 for each in findings):
        return "not decidable"
    return "explained"
