"""The first page: verdict and findings, for a person who knows gait and no statistics."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from ...report import page
from ..finding import Finding
from ..outcome import Outcome
from .meanings import FAULTS, MEANINGS

_VERDICTS = {
    "no mismatch": "The insole does what its model says: what is left is noise.",
    "explained": "The insole differs from its model, and what was found explains it.",
    "partly explained": "The insole differs from its model. A part of that is explained, a part is not.",
    "unexplained": "The insole differs from its model, and no known effect explains it.",
    "not decidable": "The insole differs from its model, and these recordings cannot tell between the explanations.",
}


def verdict_sentence(diagnosis: Outcome) -> str:
    """Return the verdict as a sentence."""
    return _VERDICTS[diagnosis.verdict]


def findings(diagnosis: Outcome) -> str:
    """Return the findings as HTML; faults of one kind together."""
    if not diagnosis.findings:
        return page.paragraph("Nothing was found that moves the readings by more than their noise hides.")
    physics = [
        _item(_meaning(finding), _text(finding)) for finding in diagnosis.findings if finding.effect not in FAULTS
    ]
    faults: dict[str, list[Finding]] = {}
    for finding in diagnosis.findings:
        if finding.effect in FAULTS:
            faults.setdefault(finding.effect, []).append(finding)
    broken = [_item(_meaning(of_kind[0]), _places(of_kind)) for of_kind in faults.values()]
    return f"<dl>{''.join(physics + broken)}</dl>"


def _item(head: str, text: str) -> str:
    return f"<dt>{escape(head[:1].upper() + head[1:])}</dt><dd>{escape(text[:1].upper() + text[1:])}</dd>"


def _meaning(finding: Finding) -> str:
    words = [finding.effect, *finding.alternatives]
    return "; or ".join(f"{word.replace('_', ' ')}: {MEANINGS[word]}" for word in words)


def _text(finding: Finding) -> str:
    return f"{finding.sentence} Confidence {finding.confidence:.0%}."


def _places(findings_of_kind: Sequence[Finding]) -> str:
    """Return the sentences of one kind of fault, which state the places."""
    return " ".join(f"{finding.sentence[:1].upper()}{finding.sentence[1:]}" for finding in findings_of_kind)
