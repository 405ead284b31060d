"""Page one: what was found, where, and what it is worth, for a person who knows gait and no statistics."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from ...report import page
from ...report.bars import bars
from ...report.insole_map import value_map, word_map
from ...report.plot import Plot, axis
from ...skin.geometry import N_TAXELS
from ..diagnosing import Diagnosis
from ..explained import Insole
from ..finding import Finding
from ..groups import LEAST_EXCESS, Named
from ..naming import Tried
from ..outcome import Outcome
from ..places import said
from .meanings import FAULTS, MEANINGS
from .untouched import Untouched

SHOWN_S = 40.0  # of the trace: so that a cycle can be seen

_VERDICTS = {
    "no mismatch": "The insole does what its model says: what is left is noise.",
    "explained": "The insole differs from its model, and what was found explains it.",
    "partly explained": "The insole differs from its model. A part of that is explained, a part is not.",
    "unexplained": "The insole differs from its model, and no known effect explains it.",
    "not decidable": "The insole differs from its model, and these recordings cannot tell between the explanations.",
}


def verdict(diagnosis: Outcome) -> str:
    """One sentence."""
    return _VERDICTS[diagnosis.verdict]


def facts(diagnosis: Diagnosis) -> str:
    """The three numbers that everybody asks for first."""
    heldout = diagnosis.heldout
    before, after, floor = (float(heldout[name]) for name in ("before", "after", "floor"))
    there, left = before**2 - floor**2, max(after**2 - floor**2, 0.0)
    taken = f"{max(1 - left / there, 0.0):.0%}" if there > LEAST_EXCESS**2 * floor**2 else "–"
    return page.facts(
        (f"{before:.2f} counts", "error before"),
        (f"{after:.2f} counts", "error after"),
        (f"{floor:.2f} counts", "noise: no model gets below"),
        (taken, "of the mismatch is explained"),
        (f"{int(diagnosis.located.affected.sum())} of {len(diagnosis.insole.slots)}", "taxels show more than noise"),
    )


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
    """One sentence, or where, if it is the same in many places; the table of faults has the rest."""
    if len(found) == 1:
        return found[0].sentence
    return f"{', '.join(said(each.where) for each in found)}: see the faults below."


def maps(diagnosis: Diagnosis) -> str:
    """Where the static model fails, and what was said of each part."""
    insole, located = diagnosis.insole, diagnosis.located
    values = np.full(len(insole.layout) * N_TAXELS, np.nan)
    values[located.slots] = located.excess
    drawn = [
        page.figure(
            value_map(insole.layout, values, "× noise", "mismatch of every taxel", from_zero=True),
            "How much the static model misses of each taxel, in units of the noise of one reading. Less than "
            f"{LEAST_EXCESS:g} is not worth a word. Toes are up, the wearer's left is left.",
        )
    ]
    words = dict.fromkeys(located.slots.tolist(), "static")
    for each, decided in zip(located.named, diagnosis.decided, strict=True):
        word = "unknown" if decided.unknown else " + ".join(decided.best.words) or "static"
        words |= dict.fromkeys(each.group.slots.tolist(), word)
    if len(set(words.values())) > 1:
        text = "What explains which taxel; “static” needs nothing beyond its curve."
        drawn.append(page.figure(word_map(insole.layout, words, "static", "what explains each taxel"), text))
    return page.row(*drawn)


def trace(seen: Untouched) -> str:
    """Before and after where the difference is greatest."""
    at = _window(seen)
    t = seen.t_s[at]
    time = axis("time, s", t)
    load = Plot(time, axis("load, kPa", seen.load_pa[at] / 1e3), height=150)
    load.line(t, seen.load_pa[at] / 1e3, 2)
    left = Plot(time, axis("error, counts", seen.before[at], seen.after[at]), height=220)
    left.line(t, seen.before[at], 1, "without the effects")
    if seen.explained:
        left.line(t, seen.after[at], 0, "with what was found")
    return page.figure(
        load.svg("load over time") + left.svg("error over time, before and after"),
        "Mean error of the taxels concerned, on blocks of time that the model shown had not seen when it was fitted; "
        f"the {t[-1] - t[0]:.0f} s in which it matters most.",
    )


def staircase(insole: Insole, named: Named) -> str:
    """Held-out error as one effect after another is admitted."""
    steps = _steps(named)
    rms = [_count(insole, named, each.left_heldout) for each in steps]
    names = ["static curves alone", *(f"with {' + '.join(each.words)}" for each in steps[1:])]
    rows = [
        (name, value, f"{value:.3f}", 1 if at == 0 else 0)
        for at, (name, value) in enumerate(zip(names, rms, strict=True))
    ]
    floor = _count(insole, named, 0.0)
    return page.figure(
        bars(rows, "held-out error as effects are admitted", (floor, f"noise {floor:.3f}")),
        "Error of one reading in counts (RMS), on held-out blocks, as one effect after the other is admitted.",
    )


def _steps(named: Named) -> list[Tried]:
    """Nothing, then the best part of the winner of each size."""
    naming = named.naming
    found = [naming.null]
    for size in range(1, len(naming.best.words)):
        parts = [t for t in naming.tried if len(t.words) == size and set(t.words) < set(naming.best.words)]
        if parts:
            found.append(min(parts, key=lambda each: each.left_heldout))
    return [*found, naming.best] if naming.best.words else found


def _count(insole: Insole, named: Named, left: float) -> float:
    own = insole.noise_of(named.group.slots)
    above = named.group.per_taxel(named.naming.excess)
    return float(np.sqrt(np.mean(own**2) * (1.0 + above * max(left, 0.0))))


def _window(seen: Untouched) -> NDArray[np.intp]:
    """Rows of the SHOWN_S in which the explanation changes most."""
    change = np.cumsum((seen.before - seen.after) ** 2 if seen.explained else seen.before**2)
    best, found = -1.0, np.arange(len(seen.t_s))
    for start in range(0, len(seen.t_s), 10):
        inside = np.flatnonzero(
            (seen.recording == seen.recording[start])
            & (seen.t_s >= seen.t_s[start])
            & (seen.t_s < seen.t_s[start] + SHOWN_S)
        )
        gain = float(change[inside[-1]] - change[inside[0]])
        if gain > best:
            best, found = gain, inside
    return found
