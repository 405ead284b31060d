"""Result of the search for the terms of one recording, with the figures by which results are compared."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ..physics.law import Array
from .model.blocks import BlockDesign
from .model.nuisance import USUAL, Priors
from .model.refine import Refined, refine
from .model.regression import PlacedTerm
from .placements import FittedPlacement
from .select.corrected_rows import with_uncertain_switching
from .select.count_errors import residual_with_companions
from .select.heldout_errors import heldout_errors
from .select.refined_settings import RefinedSettings
from .select.timing_search import TimingFit, TimingHypothesis
from .select.wrench_errors import HeldoutErrors

AT_BOUND = 0.99  # of the bound of a sum of shares


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The best timing hypothesis of one recording with its set, and the other hypotheses."""

    first: TimingFit[Any]  # the best hypothesis
    others: tuple[TimingHypothesis, ...]
    placed: tuple[FittedPlacement, ...] = ()
    priors: Priors = USUAL  # of the nuisances in the search
    settings: RefinedSettings = field(default_factory=dict)  # of strong events and snaps, refined before the search
    before: Array | None = None  # (1,) RMS error of the model as handed in, with taxels at the layout's places, counts

    @property
    def criterion(self) -> float:
        """Squared residual plus penalties plus log determinant of the nuisances, to compare searches."""
        first = self.first
        return float(first.criterion + self._log_determinant + sum(placement.penalty for placement in self.placed))

    @property
    def deviance(self) -> float:
        """Squared residual plus log determinant of the nuisances: −2 ln of the likelihood, plus a constant."""
        return float(self.first.search.design.total - self.first.best.gain + self._log_determinant)

    @property
    def _log_determinant(self) -> float:
        """Return that of the nuisances; 0 for a walk, whose nuisances are the same in every search."""
        design = self.first.search.design
        return design.log_determinant if isinstance(design, BlockDesign) else 0.0

    @cached_property
    def deviance_while_switching(self) -> float:
        """Return the deviance of the same fit with a larger variance while the snaps of the set switch."""
        design = self.refined.design
        if not isinstance(design, BlockDesign):
            return self.deviance
        switching_pa = with_uncertain_switching(design.unmoved, self.refined).switching_pa
        if switching_pa is None:
            return self.deviance
        more = (switching_pa * design.weights).T ** 2  # variance, relative to that of the row
        square = residual_with_companions(self.refined) ** 2
        return self.deviance - float(np.sum(square * more / (1.0 + more) - np.log1p(more)))

    @property
    def misfit(self) -> float:
        """Sum of squares that the laws of the best set may fail to describe."""
        first = self.first
        return first.search.penalties.misfit(self._chosen, first.best.shares)

    @property
    def n_terms(self) -> int:
        """Number of terms of the best set, including delay and lag of the whole insole."""
        return len(self.first.best.chosen) + len(self.first.words)

    @property
    def is_at_bound(self) -> bool:
        """Return whether a term that may have a wider bound reaches that of the sum of its shares."""
        first = self.first
        return any(
            one.term.wide_sum_bound is not None and float(own.sum()) > AT_BOUND * one.term.known_sum_bound
            for one, own in zip(self._chosen, first.best.shares, strict=True)
        )

    @property
    def _chosen(self) -> list[PlacedTerm]:
        """Return the terms of the best set."""
        return [self.first.search.design.candidates[k] for k in self.first.best.chosen]

    @property
    def has_loop(self) -> bool:
        """Whether the best set contains a memory or a snap, of which a calibration may contain the mean curve."""
        return any(candidate.term.is_loop for candidate in self._chosen)

    @cached_property
    def refined(self) -> Refined[Any]:
        """Return the best set with refined parameters."""
        return refine(self.first.search.design, self.first.best.chosen)

    @cached_property
    def errors(self) -> HeldoutErrors:
        """Return the held-out errors of the refined set."""
        return heldout_errors(self.refined, (), self.first.timing)

    @property
    def heldout_excess(self) -> float:
        """Return the held-out mean square error of the readings with the laws of the best set, less the floor, counts².

        Of a walk, the sum over the channels of the mean square error relative to that of the model handed in: its floor
        depends on the set.
        """
        errors = self.errors
        if isinstance(self.refined.design, BlockDesign):
            return float(errors.after[0] ** 2 - errors.floor[0] ** 2)
        return float(np.sum((errors.after / np.maximum(errors.before, 1e-12)) ** 2))
