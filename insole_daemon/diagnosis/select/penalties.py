"""Penalties of sets of candidates: the gain that a set needs to be selected, in variances of the noise.

A penalty has three parts: the gain of the smallest effect that is reported; a complexity penalty for free shares (as in
the Bayesian information criterion, Schwarz, Ann. Statist. 6 (1978) 461) and for the places and settings that were
searched; and the misfit of the other terms' laws, which a wrongly selected term could explain.

If only the wrench is known, all places add to the same rows. If the load is known on every taxel, each triangle has
rows of its own, and the penalty of a term depends on its triangles.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from ...physics.law import Array
from ..model.blocks import BlockDesign
from ..model.design import Design
from ..model.regression import PlacedTerm, Regression
from .block_penalties import BlockPenalties
from .wrench_penalties import WrenchPenalties


class Penalties(Protocol):
    """Penalties of the sets of one design."""

    most_terms: int  # largest number of terms in a set

    def least_gain(self, k: int) -> float:
        """Return the gain of the smallest effect that candidate `k` may report; margins are in this unit."""

    def complexity_penalty(self, candidate: PlacedTerm) -> float:
        """Return the penalty for free shares and for the places and settings that were searched."""

    def term_penalty(self, k: int, candidate: PlacedTerm, terms: Sequence[PlacedTerm]) -> float:
        """Return the penalty of `candidate`, number `k`, in the set `terms`, without the misfit of the other terms."""

    def least_penalty(self, k: int) -> float:
        """Return the smallest penalty of candidate `k` in any set."""

    def set_penalty(
        self, chosen: Sequence[int], terms: Sequence[PlacedTerm], shares: Sequence[Array], left: float
    ) -> float:
        """Return the penalty of a set with the misfit of its laws; inf if the set is no valid model.

        `chosen`: numbers of the candidates `terms`; `shares`: their fitted shares; `left`: the squared residual.
        """

    def timing_penalty(self, terms: Sequence[PlacedTerm], shares: Sequence[Array], left: float) -> float:
        """Return the penalty of a delay or a lag of the whole insole beside the set `terms`.

        `left`: the squared residual of both.
        """

    def misfit(self, terms: Sequence[PlacedTerm], shares: Sequence[Array]) -> float:
        """Return the sum of squares that the laws of the set `terms` may fail to describe."""

    def tolerated_loss(self, candidate: PlacedTerm, shares: Array) -> float:
        """Return how much less a preferred term (Term.yields_to) in the place of `candidate` may explain."""


def penalties_of(design: Regression) -> Penalties:
    """Return the penalties for a known load or for a wrench, by the type of `design`."""
    if isinstance(design, BlockDesign):
        return BlockPenalties(design)
    assert isinstance(design, Design)
    return WrenchPenalties(design)
