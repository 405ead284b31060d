"""Which taxels say the same, and what each group of them says: place before name, and place again after it.

The static model is fitted first. Taxels that it leaves with more than their noise are looked at together; where one
explanation leaves some of them with clearly more than the others, these are looked at by themselves. So an effect of
a single taxel is not diluted among 280, and one of all is not asked 280 times.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics.law import Array
from .candidate import Candidate
from .evidence import Group, Taxels, gather
from .fit import Evidence, Fitted, Hypothesis
from .naming import Naming, name
from .strengths import amounts, freed

LEAST_EXCESS = 0.3  # of a reading's noise: less is no mismatch worth a word
SIGMAS = 5.0  # of what the mean square of noise alone does
LATE = 0.6  # of a board's mismatch that clocks of its own take away: it is read later than the others
APART = 0.2  # of a taxel's own mismatch that an explanation leaves: it is another one's
APART_SIGMAS = 8.0  # of how the mismatch scatters in the calmer half of the taxels
LONE = 4
IDLE = 0.5  # of what an effect does to taxels that feel it little: those that all feel less do not feel it
MEANS = 10  # steps until two means no longer move
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
    """(m,) RMS that a hypothesis leaves of every taxel beyond its noise, in units of a reading's noise.

    Each taxel has strengths of its own: one that answers more than the others is not explained by other physics.
    """
    hypothesis = Hypothesis(group.taxels, fitted.candidates)
    taxels = freed(hypothesis, hypothesis.at(fitted.theta))
    found: Array = np.sqrt(np.maximum(np.mean(taxels.residual**2, axis=0) - group.floors, 0.0))
    return found


def locate(
    taxels: Taxels,
    candidates: Mapping[str, Candidate],
    jumps: Array,
    deadline: float,
    progress: Callable[[str], None],
) -> Located:
    """Groups of the `taxels`, and what explains each; after `deadline` (monotonic) only small sets are tried."""
    slots = taxels.slots
    every = gather(taxels, jumps)
    null = Hypothesis(every.evidence, ()).fit()
    left = excess(every, null)
    # Taxels with a mismatch of their own bend the clocks for all: these are asked of the calmer half.
    calm = np.sort(np.argsort(left, kind="stable")[: max(len(slots) // 2, 1)])
    half = gather(taxels.some(calm), jumps)
    null = Hypothesis(every.evidence, ()).at(Hypothesis(half.evidence, ()).fit().theta)
    left = excess(every, null)
    # What a few do not share with the many has to stand out among these too.
    lower = left[calm]
    middle = float(np.median(lower))
    usual = middle + APART_SIGMAS * 1.4826 * float(np.median(np.abs(lower - middle))) if middle < LEAST_EXCESS else 0.0
    affected = left > np.maximum(_chance(every), max(LEAST_EXCESS, usual))
    progress(f"{int(affected.sum())} of {len(slots)} taxels differ from the static model")
    named: list[Named] = []
    if affected.any():
        first = np.arange(len(slots)) if affected.mean() > 0.6 else np.flatnonzero(affected)
        _name(taxels, candidates, jumps, first, left, deadline, progress, named, 1)
    return Located(slots, left, affected, null, every.taxels, tuple(named))


def _name(
    taxels: Taxels,
    candidates: Mapping[str, Candidate],
    jumps: Array,
    columns: NDArray[np.intp],
    before: Array,
    deadline: float,
    progress: Callable[[str], None],
    named: list[Named],
    depth: int,
) -> None:
    if depth > 1 and not (before[columns] > LEAST_EXCESS).any():
        return
    group = gather(taxels.some(columns), jumps)
    progress(f"searching what explains {len(columns)} taxels")
    naming = name(group.evidence, candidates, group.floor, deadline)
    after = excess(group, naming.best.fitted)
    still = after > np.maximum(np.maximum(APART * before[columns], LEAST_EXCESS), _chance(group))
    # All of them, or a part that is as bad as the rest: the explanation is poor, not the grouping.
    apart = still & (after > 3.0 * np.median(after))
    if apart.sum() < LONE:  # a taxel or two that answer more or less than the others are no place
        apart &= after > 2 * APART * before[columns]
    if not (apart.any() and apart.mean() < 0.6):
        apart = _late(group, naming.best.fitted, taxels.boards[columns])
    if not (apart.any() and apart.mean() < 0.6):
        apart = _idle(group, naming.best.fitted)
    if depth < MOST_DEPTH and apart.any():
        for part in (columns[apart], columns[~apart]):
            _name(taxels, candidates, jumps, part, before, deadline, progress, named, depth + 1)
    else:
        named.append(Named(group, naming))


def _chance(group: Group) -> Array:
    """(m,) what a taxel may leave by chance, as `excess` has it; a block's floor is itself estimated."""
    return np.asarray(np.sqrt(SIGMAS * np.sqrt(5.0 / len(group.evidence.y)) * group.floors))


def _idle(group: Group, best: Fitted) -> NDArray[np.bool_]:
    """(m,) taxels to which the effect that is at work in the others does next to nothing; none: False."""
    hypothesis = Hypothesis(group.taxels, best.candidates)
    clearest, found = IDLE, np.zeros(len(group.slots), bool)
    for amount in amounts(hypothesis, hypothesis.at(best.theta)) if best.candidates else ():
        works = amount > amount.max() / 2
        for _ in range(MEANS):
            if works.all():
                break
            works = amount > (amount[works].mean() + amount[~works].mean()) / 2
        if works.all() or amount[works].mean() < LEAST_EXCESS:
            continue
        little = float(np.quantile(np.abs(amount[~works]), 0.95) / np.quantile(amount[works], 0.05))
        if little < clearest:
            clearest, found = little, ~works
    return found


def _late(group: Group, best: Fitted, boards: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(m,) taxels of the one of the `boards` (m,) whose clocks would explain much more of it if they were its own."""
    late = np.zeros(len(group.slots), bool)
    gains = []
    for board in np.unique(boards) if best.clocks().size else ():
        columns = np.flatnonzero(boards == board)
        own = Hypothesis(group.taxels.of_taxels(columns), best.candidates)
        together, alone = own.at(best.theta), own.fit_clocks(best.theta)
        above = max(together.mean_square() - float(group.floors[columns].mean()), 1e-12)
        gains.append((1.0 - (alone.mean_square() - float(group.floors[columns].mean())) / above, above, board))
    if gains:
        gain, above, board = max(gains)
        if gain > LATE and above > LEAST_EXCESS**2 and len(gains) > 1:
            late = boards == board
    return late
