"""Which taxels say the same, and what each group of them says: place before name, and place again after it.

The static model is fitted first. Taxels that it leaves with more than their noise are looked at together; where one
explanation leaves some of them with clearly more than the others, these are looked at by themselves. So an effect of
a single taxel is not diluted among 280, and one of all is not asked 280 times.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics.law import Array
from .candidate import Candidate
from .evidence import Group, gather
from .fit import Evidence, Fitted, Hypothesis
from .naming import Naming, name
from .observed import Observed

LEAST_EXCESS = 0.2  # of a reading's noise: less is no mismatch worth a word
SIGMAS = 5.0  # of what the mean square of noise alone does
APART = 0.4  # of a taxel's own mismatch that an explanation leaves: it is another one's
MOST_DEPTH = 3


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """A group with its explanation."""

    group: Group
    naming: Naming


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """Where the static model fails, and the groups that were named."""

    slots: NDArray[np.intp]  # (m,) all that were asked
    excess: Array  # (m,) RMS that the static model leaves beyond the noise, in units of a reading's noise
    affected: NDArray[np.bool_]  # (m,)
    null: Fitted  # of all taxels
    taxels: Evidence  # all of them
    named: tuple[Named, ...]


def excess(group: Group, fitted: Fitted) -> Array:
    """(m,) RMS that a hypothesis leaves of every taxel beyond its noise, in units of a reading's noise."""
    taxels = Hypothesis(group.taxels, fitted.candidates).at(fitted.theta)
    found: Array = np.sqrt(np.maximum(np.mean(taxels.residual**2, axis=0) - group.floors, 0.0))
    return found


def locate(
    observed: Sequence[Observed],
    candidates: Mapping[str, Candidate],
    noise_count: Array,
    jumps: Array,
    deadline: float,
    progress: Callable[[str], None],
) -> Located:
    """Groups of taxels, and what explains each; after `deadline` (monotonic) only small sets are tried."""
    slots = observed[0].slots
    every = gather(observed, slots, noise_count, jumps)
    null = Hypothesis(every.evidence, ()).fit()
    left = excess(every, null)
    # Taxels with a mismatch of their own bend the clocks for all: these are asked of the calmer half.
    calm = np.sort(np.argsort(left, kind="stable")[: max(len(slots) // 2, 1)])
    half = gather(observed, slots[calm], noise_count[calm], jumps)
    null = Hypothesis(every.evidence, ()).at(Hypothesis(half.evidence, ()).fit().theta)
    left = excess(every, null)
    n = len(every.evidence.y)
    chance = np.sqrt(SIGMAS * np.sqrt(5.0 / n) * every.floors)  # a block's floor is itself estimated
    affected = left > np.maximum(chance, LEAST_EXCESS)
    progress(f"{int(affected.sum())} of {len(slots)} taxels differ from the static model")
    named: list[Named] = []
    if affected.any():
        first = np.arange(len(slots)) if affected.mean() > 0.6 else np.flatnonzero(affected)
        _name(observed, candidates, noise_count, jumps, first, left, deadline, progress, named, 1)
    return Located(slots, left, affected, null, every.taxels, tuple(named))


def _name(
    observed: Sequence[Observed],
    candidates: Mapping[str, Candidate],
    noise_count: Array,
    jumps: Array,
    columns: NDArray[np.intp],
    before: Array,
    deadline: float,
    progress: Callable[[str], None],
    named: list[Named],
    depth: int,
) -> None:
    group = gather(observed, observed[0].slots[columns], noise_count[columns], jumps)
    progress(f"searching what explains {len(columns)} taxels")
    naming = name(group.evidence, candidates, group.floor, deadline)
    after = excess(group, naming.best.fitted)
    still = after > np.maximum(APART * before[columns], 2 * LEAST_EXCESS)
    # All of them, or a part that is as bad as the rest: the explanation is poor, not the grouping.
    apart = still & (after > 3.0 * np.median(after))
    if depth < MOST_DEPTH and apart.any() and apart.mean() < 0.6:
        for part in (columns[apart], columns[~apart]):
            _name(observed, candidates, noise_count, jumps, part, before, deadline, progress, named, depth + 1)
    else:
        named.append(Named(group, naming))
