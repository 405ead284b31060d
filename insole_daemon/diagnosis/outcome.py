"""The result of a diagnosis: the content of `insole-diagnosis/1`, its verdict and its shares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from ..physics.law import Array
from .finding import Finding, Verdict

MOST_AFTER = 1.15  # times the floor: largest error of the verdict `explained` (formats.md)
LEAST_EXPLAINED = 0.2  # of the mismatch: least for the verdict `partly explained` (formats.md)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Outcome:
    """The result of a diagnosis; `document` is its content as a file."""

    recordings: tuple[str, ...]
    against: Literal["model", "simulation"]
    verdict: Verdict
    heldout: Mapping[str, Any]  # unit, before, after, floor
    clocks: Array  # (recordings, 2) offset_s and rate of the reference's clock
    findings: tuple[Finding, ...]
    rejected: tuple[Mapping[str, str], ...]
    not_identifiable: tuple[Mapping[str, str], ...]
    model: Mapping[str, Any]

    def before_and_after(self) -> tuple[float, float]:
        """Return the RMS errors before and after, in the unit whose square the findings explain."""
        return float(self.heldout["before"]), float(self.heldout["after"])

    def document(self) -> dict[str, Any]:
        """Return the content of `insole-diagnosis/1`."""
        explained, aligned = shares([finding.explains for finding in self.findings], *self.before_and_after())
        return {
            "format": "insole-diagnosis/1",
            "recordings": list(self.recordings),
            "against": self.against,
            "verdict": self.verdict,
            "heldout": dict(self.heldout),
            "alignment_share": round(aligned, 4),
            "alignment": [
                {"recording": name, "offset_s": round(offset, 5), "rate": round(rate, 8)}
                for name, (offset, rate) in zip(self.recordings, self.clocks.tolist(), strict=True)
            ],
            "findings": [
                {**finding.document(), "explains": round(share, 4)}
                for finding, share in zip(self.findings, explained, strict=True)
            ],
            "rejected": [dict(entry) for entry in self.rejected],
            "not_identifiable": [dict(entry) for entry in self.not_identifiable],
        }


def verdict(
    before: float, after: float, floor: float, null_before: float, *, findings: int, unknown: int, undecided: bool
) -> Verdict:
    """Return the verdict of formats.md for any kind of recording.

    `before`, `after`, `floor`: RMS errors in one unit. `null_before`: the largest `before` that this recording shows
    without any mismatch. `findings`: their number; `unknown`: number of those without a name. `undecided`: another set
    of findings explains the data equally well.
    """
    if not findings:
        return "no mismatch" if before <= null_before else "unexplained"
    if unknown == findings:
        return "unexplained"
    if undecided and not unknown:
        return "not decidable"
    if not unknown and after <= MOST_AFTER * floor:
        return "explained"
    mismatch = before**2 - floor**2
    return "partly explained" if before**2 - after**2 >= LEAST_EXPLAINED * mismatch else "unexplained"


def shares(gains: Sequence[float], before: float, after: float) -> tuple[tuple[float, ...], float]:
    """Return the share of before² − after² that each finding explains, and that of clocks and priors; their sum is 1.

    `gains`: mean squares by which the findings reduce the error in order, in the unit of `before`². If they sum to more
    than the whole, because effects overlap, each is reduced in proportion.
    """
    whole = max(before**2 - after**2, 0.0)
    positive_gains = [max(gain, 0.0) for gain in gains]
    scale = max(whole, sum(positive_gains))
    if not scale > 0:
        return tuple(0.0 for _ in positive_gains), 1.0
    explained = tuple(gain / scale for gain in positive_gains)
    return explained, 1.0 - sum(explained)
