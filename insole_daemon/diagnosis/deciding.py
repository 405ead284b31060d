"""From subsets and what they leave to words: what is named, what cannot be told apart, what nothing known explains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .candidate import Excitation
from .naming import AS_GOOD, Naming, Tried

UNEXPLAINED = 0.25  # of the mismatch that the best subset leaves: it is something else
# Of the mismatch: what one family may miss of a material that is of its kind, by the excitation that is missing.
MISFIT = {"speeds": 0.1, "holds": 0.05, "temperature": 0.1}
SIGMAS = 4.0
# That neither a word nor its alternatives are there, where other words leave as little: of the project's own trials
# (benchmarks/diagnosis/training.py --seed 606 --cases 54) one in eleven with rivals within five times, none of 46
# beyond.
DOUBT = 0.2
HOLD_S = 12.0  # shorter, and what relaxes and what creeps look alike

# Words that only the stated excitation tells apart; without it a family's own misfit would decide.
TWINS: Mapping[frozenset[str], str] = {
    frozenset({"hysteresis", "creep"}): "speeds",
    frozenset({"hysteresis", "viscoelasticity"}): "speeds",
    frozenset({"creep", "viscoelasticity"}): "holds",
    frozenset({"temperature", "drift"}): "temperature",
    frozenset({"lag", "delay"}): "speeds",
    frozenset({"lag", "viscoelasticity"}): "speeds",
    frozenset({"creep", "drift"}): "holds",
    frozenset({"hysteresis", "lag"}): "speeds",
    frozenset({"hysteresis", "delay"}): "speeds",
    frozenset({"creep", "lag"}): "speeds",
    frozenset({"creep", "delay"}): "speeds",
    frozenset({"viscoelasticity", "delay"}): "speeds",
    frozenset({"lag", "clock"}): "speeds",
    frozenset({"hysteresis", "clock"}): "speeds",
    frozenset({"creep", "clock"}): "speeds",
    frozenset({"viscoelasticity", "clock"}): "speeds",
}
RECORD: Mapping[str, str] = {
    "speeds": "the same cycle at two speeds, one at least three times the other, and a hold of 60 s",
    "holds": "a hold of at least 60 s, then 60 s without load",
    "temperature": "the insole warming up and cooling down again",
}


@dataclass(frozen=True, slots=True, eq=False)
class Decided:
    """What is said of one group."""

    best: Tried
    alternatives: Mapping[str, tuple[str, ...]]  # by word
    unknown: bool
    confidence: Mapping[str, float]  # by word
    alone: Mapping[str, Tried]  # by word: the subset without it


def sure(rival: float, best: float) -> float:
    """How sure what leaves `best` is, where the best without it leaves `rival`."""
    return float(np.clip(1.0 - DOUBT * best / max(rival, 1e-6), 1.0 - DOUBT, 0.99))


def shown(excitation: Excitation) -> frozenset[str]:
    """Which of the excitations of TWINS the data hold."""
    found = set()
    if excitation.two_speeds:
        found.add("speeds")
    if excitation.hold_s >= HOLD_S:
        found.add("holds")
    if excitation.temperature_reverses:
        found.add("temperature")
    return frozenset(found)


def by_chance(naming: Naming, rows: int) -> float:
    """The part of the mismatch that `rows` of its evidence may say less or more by their noise."""
    return SIGMAS * naming.floor * float(np.sqrt(2.0 / rows)) / naming.excess


def unexplained(naming: Naming, rows: int) -> bool:
    """Whether the best set leaves too much to be asserted; `rows`: of its evidence."""
    return naming.best.left_heldout > max(UNEXPLAINED, by_chance(naming, rows))


def decide(naming: Naming, excitation: Excitation, rows: int) -> Decided:
    """What is said of the group that `naming` searched; `rows`: of its evidence."""
    best = naming.best
    chance = by_chance(naming, rows)
    unknown = unexplained(naming, rows)
    alternatives: dict[str, tuple[str, ...]] = {}
    confidence: dict[str, float] = {}
    alone: dict[str, Tried] = {}
    there = shown(excitation)
    for word in best.words:
        swaps = []
        for tried in naming.tried:
            others = set(tried.words) - set(best.words)
            if len(tried.words) != len(best.words) or set(best.words) - set(tried.words) != {word}:
                continue
            (other,) = others
            at = tried.fitted.words.index(other)
            pair = frozenset({word, other})
            # Told apart by their excitation, twins differ by more than chance; else by more than families do.
            needed = TWINS.get(pair, "")
            misfit = 0.0 if needed in there else MISFIT.get(needed, 0.0)
            if not misfit and tried.fitted.candidates[at].is_really(tried.fitted.values()[at]) == word:
                continue  # the same physics in the other's words
            limit = max(AS_GOOD * best.left_heldout, best.left_heldout + chance, misfit)
            if tried.left_heldout <= limit:
                swaps.append((tried.left_heldout, other))
        alternatives[word] = tuple(other for _, other in sorted(swaps))
        smaller = [t for t in naming.tried if set(t.words) == set(best.words) - {word}]
        alone[word] = smaller[0] if smaller else naming.null
        lost = alone[word].left_heldout - best.left_heldout
        rival = min(
            (t.left_heldout for t in naming.tried if word not in t.words and len(t.words) <= len(best.words)),
            default=1.0,
        )
        confidence[word] = sure(rival, max(best.left_heldout, chance, 1e-3)) if lost > 0 else 0.5
    return Decided(best, alternatives, unknown, confidence, alone)
