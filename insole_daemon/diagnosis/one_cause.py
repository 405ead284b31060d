"""One cause, one name: what two groups are off by in the same way is not called by two words.

Groups are explained by themselves, and where an effect's twin does as well, noise decides which of the two comes first.
A larger group that tells them apart has decided it for the smaller one too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from .candidate import Excitation
from .deciding import Decided, decide
from .groups import Named


def of_one_cause(named: Sequence[Named], excitation: Excitation) -> tuple[Named, ...]:
    """The groups, each with the words of a larger one where these do as well as its own."""
    decided = [decide(each.naming, excitation, each.group.evidence.y.size) for each in named]
    return tuple(_renamed(each, own, named, decided) for each, own in zip(named, decided, strict=True))


def _renamed(each: Named, own: Decided, named: Sequence[Named], decided: Sequence[Decided]) -> Named:
    """`each`, decided as `own`, with the words of larger ones of the `named`."""
    told = {
        word
        for other, said in zip(named, decided, strict=True)
        if len(other.group.slots) > len(each.group.slots) and not said.unknown
        for word in said.best.words
        if not said.alternatives[word]
    }
    for word, twins in own.alternatives.items():
        for twin in twins:
            if twin in told and word not in told:
                words = set(own.best.words) - {word} | {twin}
                best = next(tried for tried in each.naming.tried if set(tried.words) == words)
                return replace(each, naming=replace(each.naming, best=best))
    return each
