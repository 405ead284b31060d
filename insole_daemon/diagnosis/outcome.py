"""What every diagnosis comes to, whatever was known of the load: the content of `insole-diagnosis/1`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from ..physics.law import Array
from .finding import Finding, Verdict

MOST_AFTER = 1.15  # times the floor: it is explained (formats.md)
LEAST_EXPLAINED = 0.2  # of the mismatch: it is explained in part (formats.md)


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

    def before_and_after(self) -> tuple[float, float]:
        """RMS errors in the unit whose square the findings explain."""
        return float(self.heldout["before"]), float(self.heldout["after"])

    def document(self) -> dict[str, Any]:
        """As `insole-diagnosis/1` has it."""
        explained, aligned = shares([each.explains for each in self.findings], *self.before_and_after())
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
                {**each.document(), "explains": round(share, 4)}
                for each, share in zip(self.findings, explained, strict=True)
            ],
            "rejected": [dict(each) for each in self.rejected],
            "not_identifiable": [dict(each) for each in self.not_identifiable],
        }


def verdict(
    before: float, after: float, floor: float, null_before: float, *, findings: int, unknown: int, undecided: bool
) -> Verdict:
    """The verdict of formats.md, from numbers alone, for every kind of recording.

    `before`, `after`, `floor`: RMS errors in one unit. `null_before`: the largest `before` that this recording shows
    where nothing differs. `findings`: how many there are, `unknown` among them without a name. `undecided`: another set
    of findings explains the data as well.
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
    """Of before² − after², what each finding explains, and what is left for clocks and priors; together they are 1.

    `gains`: mean squares that the findings take away one after another, in the unit of `before`², none negative. Where
    they overlap, and sum to more than the whole, each is reduced in proportion.
    """
    whole = max(before**2 - after**2, 0.0)
    kept = [max(each, 0.0) for each in gains]
    scale = max(whole, sum(kept))
    if not scale > 0:
        return tuple(0.0 for _ in kept), 1.0
    explained = tuple(each / scale for each in kept)
    return explained, 1.0 - sum(explained)
