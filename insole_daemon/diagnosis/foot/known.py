"""What a chamber has shown, taken into walks: undone on every taxel before anything else is searched for.

Whether a walk agrees is asked of the walk: an effect is taken out again, with lag and delay free, and where the force
on steps that were held out is then told better, the walk contradicts it and is explained without it. What is undone is
computed from the few courses in time that stand out of the noise, so undoing averages no noise and cannot pass for
physics.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...physics.calibration import Calibration
from ...physics.chain import Chain
from ...physics.effect import Effect
from ...physics.law import Array
from ...skin.geometry import N_TAXELS
from ..opinion import Opinion
from . import figures
from .evidence import Evidence
from .hypothesis import Term
from .naming import TIMING, Search
from .nulls import LEAST_PRICE
from .part import part
from .walk import Walk

MEMORY = ("hysteresis", "snap", "viscoelasticity", "creep")  # of the material: it goes along from trial to trial
WORSE = 0.1  # of what is left of a walk above its noise, that an effect has to add to be contradicted


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """What is known from elsewhere: curves, and effects of the material."""

    curves: Callable[[float], Calibration]  # static, up to so many Pa
    effects: tuple[Effect, ...]

    @property
    def words(self) -> tuple[str, ...]:
        """Of the effects, each once."""
        return tuple(dict.fromkeys(each.law.word for each in self.effects))


@dataclass(frozen=True, slots=True, eq=False)
class Agreed:
    """Walks with what each agrees to undone."""

    walks: tuple[Walk, ...]
    effects: tuple[Effect, ...]  # that most walks do not contradict
    opinions: Mapping[str, Opinion]  # by word


def agreed(walks: Sequence[Walk], known: Known, progress: Callable[[str], None]) -> Agreed:
    """What of `known` the walks agree with; their pressures are by its curves already."""
    if not known.effects:
        return Agreed(tuple(walks), (), {})
    progress(f"asking the walks what they say of {' and '.join(known.words)}")
    every = _left(walks, known.effects)
    opinions = {}
    for word in known.words:
        without = _left(walks, [each for each in known.effects if each.law.word != word])
        gained = without.above - every.above
        enough = np.maximum(LEAST_PRICE, WORSE * np.minimum(without.above, every.above))
        names = np.array([walk.name for walk in walks])
        opinions[word] = Opinion(
            tuple(names[gained > enough].tolist()), tuple(names[gained < -enough].tolist()),
            (without.force_n, every.force_n),
        )  # fmt: skip
    return Agreed(
        tuple(
            undone(walk, [e for e in known.effects if walk.name not in opinions[e.law.word].contradicted_by])
            for walk in walks
        ),
        tuple(e for e in known.effects if 2 * len(opinions[e.law.word].contradicted_by) <= len(walks)),
        opinions,
    )


def undone(walk: Walk, effects: Sequence[Effect]) -> Walk:
    """`walk` with the loads that had `effects` when they were read."""
    if not effects:
        return walk
    courses_pa = part(walk).courses_pa
    signal = np.full((len(walk.t_s), len(walk.layout) * N_TAXELS), np.nan)
    signal[:, walk.slots] = courses_pa
    loads_pa = Chain(effects, walk.layout).inverse()(signal.reshape(len(signal), -1, N_TAXELS), walk.t_s)
    return replace(walk, undone_pa=loads_pa.reshape(len(signal), -1)[:, walk.slots] - courses_pa)


@dataclass(frozen=True, slots=True, eq=False)
class _Left:
    above: Array  # (walks,) mean square above the noise, in its units, of steps that were held out
    force_n: float


def _left(walks: Sequence[Walk], effects: Sequence[Effect]) -> _Left:
    """What lag and delay, and recalibration, leave of walks with `effects` undone."""
    evidence = Evidence([part(undone(walk, effects)) for walk in walks])
    search = Search(evidence, LEAST_PRICE)
    tried = search.judged(frozenset(Term(word) for word in TIMING if word in search.words))
    assert tried.heldout is not None
    assert tried.square is not None
    square = np.where(evidence.judged, tried.square, 0.0)
    n = np.bincount(evidence.of_part, evidence.judged, len(walks))
    above = np.bincount(evidence.of_part, square, len(walks)) / np.maximum(n, 1) - 1.0
    return _Left(np.maximum(above, 0.0), figures.rms(evidence, tried.heldout))
