"""Walks that contradict each other: those that say the same are explained together, and the others beside them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...physics.law import Array
from . import nulls
from .deciding import Decided, decide, refitted
from .evidence import FREE, UNDONE_PA, Evidence
from .findings import Explained, contradicted
from .hypothesis import Hypothesis
from .naming import Naming, Search
from .part import Part

LEAST_STEPS = 3  # one rise and fall fits any physics


def camps(parts: Sequence[Part], deadline: float, progress: Callable[[str], None]) -> list[Explained]:
    """All walks as one, unless that leaves too much or makes one worse: then each is asked by itself.

    The most that name the same effects stand first, with those that have too few steps to say anything; of equals those
    that were named first. After `deadline` (monotonic) only small sets are tried.
    """
    together = explained(parts, deadline, progress)
    if len(parts) == 1 or not _at_odds(together):
        return [together]
    progress("they contradict each other: asking each walk by itself")
    alone = {
        i: explained([each], deadline, progress) for i, each in enumerate(parts) if len(each.contacts) >= LEAST_STEPS
    }
    saying: dict[frozenset[str], list[int]] = {}
    for i, each in alone.items():
        saying.setdefault(each.words, []).append(i)
    if len(saying) < 2:
        return [together]
    most = max(saying.values(), key=len)
    others = [each for each in saying.values() if each is not most]
    silent = [i for i in range(len(parts)) if i not in alone]
    return [
        alone[each[0]] if len(each) == 1 else explained([parts[i] for i in each], deadline, progress)
        for each in (sorted([*most, *silent]), *others)
    ]


def explained(parts: Sequence[Part], deadline: float, progress: Callable[[str], None]) -> Explained:
    """What is decided of walks that are taken for one."""
    evidence = Evidence(parts)
    progress("noise alone: what it would explain")
    of_nulls = nulls.gains(evidence)
    search = Search(evidence, nulls.price(of_nulls))
    progress(f"searching what explains {sum(len(each.contacts) for each in parts)} steps")
    naming = search.name(deadline)
    progress("decoys: what a filter without physics explains")
    return fitted(evidence, naming, decide(search, naming), of_nulls)


def fitted(evidence: Evidence, naming: Naming, decided: Decided, of_nulls: Array) -> Explained:
    """What was decided by `evidence`, as the material has it and as it is undone."""
    parts = evidence.parts
    search = Search(Evidence(parts, FREE), naming.price)
    material = search.judged(decided.best.terms)
    if "hysteresis" in material.words:  # what undoes it best on noisy readings is not what the material is
        search = Search(evidence.with_plays(UNDONE_PA), naming.price)
    naming, decided = refitted(search, naming, decided)
    evidence = search.evidence
    hypothesis = Hypothesis(evidence, tuple(decided.best.terms))
    recalibration = evidence.recalibration(hypothesis.unexplained(decided.best.fitted), None)
    names = tuple(each.walk.name for each in parts)
    return Explained(evidence, names, naming, decided, material, recalibration, of_nulls)


def _at_odds(together: Explained) -> bool:
    decided = together.decided
    return decided.unknown or any(contradicted(together, each) for each in decided.alone.values())
