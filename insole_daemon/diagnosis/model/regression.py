"""The interface of a recording's regression that the search uses, whether the load is known or only the wrench."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...physics.effect import Where
from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..terms.term import Setting, Term

NOTHING: Mapping[str, float] = {}


@dataclass(frozen=True, slots=True)
class Timing:
    """Delay of the readings, and time constant of the lag before it, s."""

    delay_s: float = 0.0
    lag_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class PlacedTerm:
    """A candidate: one term at one place with one setting, or several joint ones."""

    term: Term
    where: Where
    settings: tuple[Setting, ...]
    columns: NDArray[np.intp]  # numbers in the design
    n_places: int  # searched places of this scope
    companions: NDArray[np.intp]  # columns of static terms that a calibration may have absorbed
    is_recalibration: bool = False  # within their priors, nuisance columns explain the same
    in_means: float = 1.0  # ratio of its mean square in triangle means to that over taxels
    companion_words: tuple[str, ...] = ()
    companion_std: tuple[float, ...] = ()  # prior of their coefficients, per coefficient of the term

    @property
    def word(self) -> str:
        """Return the effect word of the term."""
        return self.term.word

    def companions_of(self, word: str) -> list[int]:
        """Return the columns of the companions of a `word`, in the order of its settings."""
        return [k for k, own in zip(self.companions.tolist(), self.companion_words, strict=True) if own == word]

    def of_law(self) -> PlacedTerm:
        """Return the candidate with the columns of its law only."""
        law_settings = [k for k, setting in enumerate(self.settings) if self.term.is_in_law(setting)]
        return replace(self, settings=tuple(self.settings[k] for k in law_settings), columns=self.columns[law_settings])

    def without(self, words: Collection[str]) -> PlacedTerm:
        """Return the candidate without companions of these `words`."""
        kept = [i for i, word in enumerate(self.companion_words) if word not in words]
        return replace(
            self, companions=self.companions[kept], companion_words=tuple(self.companion_words[i] for i in kept),
            companion_std=tuple(self.companion_std[i] for i in kept),
        )  # fmt: skip


class Gram(Protocol):
    """Inner products (p, p), indexed as an array."""

    def __getitem__(self, index: Any, /) -> Any:
        """Return the inner products of rows and columns."""

    def diagonal(self) -> Array:
        """Return the diagonal (p,)."""


class Regression(Protocol):
    """Candidates and inner products of their p columns with nuisance columns projected out.

    y is the residual of the static model.
    """

    @property
    def load(self) -> LoadEstimate:
        """The load from which the regressors are computed."""

    @property
    def weights(self) -> Array:
        """One over the standard deviation of a row (N, c) in each of c channels; 0 if unknown."""

    @property
    def candidates(self) -> tuple[PlacedTerm, ...]:
        """The c candidates."""

    @property
    def gram(self) -> Gram:
        """(p, p) inner products of the columns."""

    @property
    def cross(self) -> Array:
        """(p,) inner products with y."""

    @property
    def total(self) -> float:
        """Sum of squares of y."""

    @property
    def n_rows(self) -> int:
        """Number of rows with a weight, in one channel."""

    @property
    def noise(self) -> float:
        """Expected sum of squares of y by noise alone."""

    @property
    def least(self) -> Array:
        """Gain (c,) of the smallest effect that each candidate may report, in variances of the noise."""

    def retimed(self, timing: Timing) -> Self:
        """Return the regression on the reference after `timing`."""

    def subset(self, chosen: Sequence[int]) -> Self:
        """Return the regression with the columns of `chosen` candidates and their companions."""

    def exchanged(self, i: int, setting: Setting) -> Self:
        """Return the regression with another setting of candidate `i`."""

    def relinearised(self, i: int, setting: Setting, shares: Sequence[Array]) -> Self:
        """Return the regression with candidate `i` linearised at `setting`, beside all with `shares`."""

    def of_laws(self) -> Self:
        """Return the regression with the laws alone, without columns and companions for their misfit."""

    def with_wider_laws(self) -> Self | None:
        """Return the regression with columns of laws that the search has not (Term.also_in_law); None without any."""

    def without_internal_companions(self) -> Self:
        """Return the regression with all columns of its candidates, without companions that are in no model."""


def with_companions(
    candidates: Sequence[PlacedTerm], of_memories: Mapping[str, float] = NOTHING
) -> tuple[PlacedTerm, ...]:
    """Return the candidates with companions: static terms at the same place that a calibration may have absorbed.

    `of_memories`: companions of memories beside those of `Term.absorbs`, with their prior standard deviations.
    """
    static_columns: dict[tuple[Where, str], list[int]] = {}
    for candidate in candidates:
        static_columns.setdefault((candidate.where, candidate.word), candidate.columns.tolist())
    with_companion = []
    for candidate in candidates:
        absorbs = {**of_memories, **candidate.term.absorbs} if candidate.term.is_memory else candidate.term.absorbs
        companions = [
            (column, word, std)
            for word, std in absorbs.items()
            for column in static_columns.get((candidate.where, word), ())
        ]  # fmt: skip
        columns, words, stds = zip(*companions, strict=True) if companions else ((), (), ())
        with_companion.append(
            replace(candidate, companions=np.array(columns, np.intp), companion_words=words, companion_std=stds)
        )  # fmt: skip
    return tuple(with_companion)


D = TypeVar("D", bound=Regression)
