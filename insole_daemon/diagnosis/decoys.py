"""Decoys: what no material can do, with the freedom of the candidate that it stands beside.

A candidate is named for what it explains of held-out blocks, and some of that any feature of its kind would explain:
one that smooths a noisy reference, one that has as many parameters, one with the same spectrum. So each effect that is
about to be named is replaced by copies of itself that are not physics, with the same parameters, bounds, starts and
folds: run backwards in time, so that the answer comes before the load; made symmetric in time, a smoother that knows
the future; with the phases of what it adds scrambled. What does not leave clearly less than these is not named. A set
that leaves too much to be asserted stays what comes nearest, decoys or not: it is for the model, which has no other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..physics.law import Array
from .candidate import Candidate, Rows
from .deciding import by_chance, unexplained
from .fit import Evidence, Fitted, Hypothesis
from .groups import Named
from .naming import AS_GOOD, Decoy, Naming, cheapest, heldout, left
from .observed import Observed

ALIKE = 0.7  # correlation of two courses of temperature: a copy that is the course itself is no decoy

Course = Callable[[Array], Array]  # (n, …) on a regular grid → the same, without its physics


def challenged(named: Named) -> Named:
    """The best explanation without effects that a decoy is as good as, and all decoys that were fitted."""
    naming, evidence = named.naming, named.group.evidence
    found: list[Decoy] = []
    lost_words: set[str] = set()
    rows = evidence.y.size
    while naming.best.words and not unexplained(naming, rows):
        best = naming.best
        limit = max(AS_GOOD * best.left_heldout, best.left_heldout + by_chance(naming, rows))
        tried = [each for word in best.words for each in _tried(naming, evidence, word, limit)]
        found += tried
        lost = min((each for each in tried if each.as_good), key=lambda each: each.left, default=None)
        if lost is None:
            break
        lost_words.add(lost.word)
        rest = [each for each in naming.tried if not lost_words & set(each.words)]
        naming = replace(naming, best=cheapest(rest))
    return replace(named, naming=replace(naming, decoys=tuple(found)))


def _decoys(candidate: Candidate, observed: Sequence[Observed]) -> Iterator[tuple[str, Candidate]]:
    """What it is called, and the decoy; none for a course that is free to be anything, as a drift is."""
    act, columns = candidate.act, candidate.columns
    if act is not None:
        for kind, of_act in _ACTS.items():
            yield kind, replace(candidate, act=of_act(act), other_word=None)
    elif columns is not None and not candidate.own_columns:
        for kind, course in (("time-reversed", _reversed), ("phase-scrambled", _scrambled)):
            if _unlike(observed, course):
                yield kind, replace(candidate, columns=_other_warmth(columns, course))


def _tried(naming: Naming, evidence: Evidence, word: str, limit: float) -> Iterator[Decoy]:
    """The decoys of one word of the best set, each in its place; `limit`: what they leave that are as good."""
    best = naming.best
    rest = _rest(best.fitted, evidence, word)
    values = {each.word: own for each, own in zip(rest.candidates, rest.values(), strict=True)}
    (candidate,) = (each for each in best.fitted.candidates if each.word == word)
    for kind, decoy in _decoys(candidate, evidence.observed):
        hypothesis = Hypothesis(evidence, [*rest.candidates, decoy])
        (values[word],) = hypothesis.promising(rest, decoy, 1)
        own = [values[each.word] for each in hypothesis.candidates]
        fitted = hypothesis.polished(hypothesis.fit(np.concatenate([rest.clocks().ravel(), *own])))
        leaves = left(fitted, evidence, naming.floor, naming.excess)
        if leaves <= limit:  # else it would leave no less of blocks that are held out
            mean_square, _ = heldout(fitted, evidence, naming.null.fitted.effective_pa.mean(axis=1))
            leaves = (mean_square - naming.floor) / naming.excess
        yield Decoy(word, kind, leaves, best.left_heldout, leaves <= limit)


def _rest(best: Fitted, evidence: Evidence, word: str) -> Fitted:
    """The set without `word`, fitted from where `best` is."""
    kept = [(each, own) for each, own in zip(best.candidates, best.values(), strict=True) if each.word != word]
    hypothesis = Hypothesis(evidence, [each for each, _ in kept])
    return hypothesis.fit(np.concatenate([best.clocks().ravel(), *(own for _, own in kept)]))


def _reversed(x: Array) -> Array:
    return x[::-1]


def _scrambled(x: Array) -> Array:
    """`x` with the same spectrum and phases drawn anew, the same ones for every signal of this length."""
    spectrum = np.fft.rfft(x, axis=0)
    phase = np.random.default_rng(0).uniform(0.0, 2 * np.pi, len(spectrum))
    phase[0] = 0.0
    scrambled: Array = np.fft.irfft((np.exp(1j * phase) * spectrum.T).T, len(x), axis=0)
    return scrambled


Act = Callable[[Array, float, Array], Array]


def _backwards(act: Act) -> Act:
    known: list[tuple[Array, Array]] = []  # an operator may know a load again, by what it is: reverse each once

    def decoy(x: Array, step_s: float, theta: Array) -> Array:
        turned = next((turned for load, turned in known if load is x), None)
        if turned is None:
            turned = _reversed(x)
            known[:] = [*known[-_MOST_KNOWN:], (x, turned)]
        return _reversed(act(turned, step_s, theta))

    return decoy


def _symmetric(act: Act) -> Act:
    backwards = _backwards(act)

    def decoy(x: Array, step_s: float, theta: Array) -> Array:
        mean: Array = (act(x, step_s, theta) + backwards(x, step_s, theta)) / 2
        return mean

    return decoy


def _scrambling(act: Act) -> Act:
    def decoy(x: Array, step_s: float, theta: Array) -> Array:
        moved: Array = x + _scrambled(act(x, step_s, theta) - x)
        return moved

    return decoy


_MOST_KNOWN = 20
_ACTS: Mapping[str, Callable[[Act], Act]] = {
    "time-reversed": _backwards,
    "symmetric in time": _symmetric,
    "phase-scrambled": _scrambling,
}


def _unlike(observed: Sequence[Observed], course: Course) -> bool:
    """Whether the `course` of the temperature is another one than it was."""
    was = [each.temperature_c for each in observed if each.temperature_c is not None]
    moved = np.concatenate([each - each.mean() for each in was])
    other = np.concatenate([course(each - each.mean()) for each in was])
    return abs(float(moved @ other)) < ALIKE * float(np.linalg.norm(moved) * np.linalg.norm(other))


def _other_warmth(columns: Callable[[Rows, Array], Array], course: Course) -> Callable[[Rows, Array], Array]:
    def decoy(rows: Rows, x: Array) -> Array:
        assert rows.temperature_c is not None
        mean = rows.temperature_c.mean()
        return columns(replace(rows, temperature_c=mean + course(rows.temperature_c - mean)), x)

    return decoy
