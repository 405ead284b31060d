"""Which error a simulated load has, by the readings: its times and its sizes differ from those of the person's load."""

from __future__ import annotations

import numpy as np

from .load_estimate import KnownLoad
from .model.blocks import BlockDesign, block_design
from .model.nuisance import USUAL, Priors, nuisance_of
from .observations.paired import PairedObservation
from .observations.reading_faults import ReadingFaults
from .select.search import SubsetSearch

# Possible errors of a simulated load: none, a measured trial, a model of the person, and a model of another person.
LOAD_ERRORS = (USUAL, Priors(0.005, 0.02), Priors(0.015, 0.06), Priors(0.05, 0.2))
NEGLIGIBLE = 0.01  # of the decrease of the deviance at the board where it is largest


def with_likely_load_error(seen: PairedObservation, faults: ReadingFaults) -> BlockDesign:
    """Return the regression under the smallest error of the simulated load whose likelihood equals that of any other.

    Likelihoods are those of the best set under each error, less the complexity of its terms but not the size that a
    reported effect must have, and equal up to the possible misfit of its laws. An error is no larger than all boards
    but one need: the simulation is one walk, so its error is not that of one board alone.
    """
    whole = block_design(KnownLoad(seen), faults.weights_of(seen))
    criteria, criteria_without_misfit = [], []
    possible = LOAD_ERRORS[: 1 + largest_but_one_board(whole)]
    for priors in possible:
        whole = whole.under(priors)
        among = SubsetSearch(whole)
        best = among.run()[0]
        every = [whole.candidates[k] for k in best.chosen]
        complexity = sum(among.penalties.complexity_penalty(candidate) for candidate in every)
        criteria.append(whole.total - best.gain + complexity + whole.nuisance.log_determinant)
        criteria_without_misfit.append(criteria[-1] - among.penalties.misfit(every, best.shares))
    return whole.under(possible[next(i for i, value in enumerate(criteria_without_misfit) if value <= min(criteria))])


def largest_but_one_board(whole: BlockDesign) -> int:
    """Return the number in LOAD_ERRORS of the largest error that a board needs without terms, one board left out.

    A board needs no larger error if that lowers its deviance per row by a negligible part of what it does at the board
    where it lowers it most. With two boards or fewer none is left out.
    """
    boards = whole.seen.layout.identities[:, 0]
    of_boards = [boards == board for board in np.unique(boards) if np.any(whole.weights[:, boards == board])]
    nuisances = [nuisance_of(whole.load, whole.weights, priors) for priors in LOAD_ERRORS]
    deviance = np.array(
        [
            [each.of(at).deviance(whole.y[at]) / np.count_nonzero(whole.weights[:, at]) for each in nuisances]
            for at in of_boards
        ]
    )
    above_least = deviance - deviance.min(axis=1, keepdims=True)
    needed = np.sort(np.argmax(above_least <= NEGLIGIBLE * above_least.max(), axis=1))
    return int(needed[-2] if len(needed) > 2 else needed[-1])
