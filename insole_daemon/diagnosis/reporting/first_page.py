"""Page one: what was found, where, and what it is worth, for a person who knows gait and no statistics."""

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
    """One sentence."""
    return _VERDICTS[diagnosis.verdict]


def findings(diagnosis: Outcome) -> str:
    """Their sentences."""
    if not diagnosis.findings:
        return page.paragraph("Nothing was found that moves the readings by more than their noise hides.")
    physics = [_item(_meant(each), _said(each)) for each in diagnosis.findings if each.effect not in FAULTS]
    faults: dict[str, list[Finding]] = {}
    for each in diagnosis.findings:
        if each.effect in FAULTS:
            faults.setdefault(each.effect, []).append(each)
    broken = [_item(_meant(own[0]), _places(own)) for own in faults.values()]
    return f"<dl>{''.join(physics + broken)}</dl>"


def _item(head: str, text: str) -> str:
    return f"<dt>{escape(head[:1].upper() + head[1:])}</dt><dd>{escape(text[:1].upper() + text[1:])}</dd>"


def _meant(found: Finding) -> str:
    words = [found.effect, *found.alternatives]
    return "; or ".join(f"{word.replace('_', ' ')}: {MEANINGS[word]}" for word in words)


def _said(found: Finding) -> str:
    return f"{found.sentence} Confidence {found.confidence:.0%}."


def _places(found: Sequence[Finding]) -> str:
    """The sentences of one fault, each with its place."""
    return " ".join(f"{each.sentence[:1].upper()}{each.sentence[1:]}" for each in found)
