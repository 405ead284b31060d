"""What the search needs of the regression of a recording, whatever is known of its load."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...physics.effect import Where
from ...physics.law import Array
from ..terms.term import Setting, Term
from .load import LoadEstimate

NOTHING: Mapping[str, float] = {}
LEAST_SIZE = 0.15  # of a reading's noise, RMS over the taxels it is at: less is no effect worth a name


@dataclass(frozen=True, slots=True)
class Timing:
    """Seconds by which readings come late, and the time constant of the lag before that."""

    delay_s: float = 0.0
    lag_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class PlacedTerm:
    """One term at one place with one setting (or several joint ones)."""

    term: Term
    where: Where
    settings: tuple[Setting, ...]
    columns: NDArray[np.intp]  # in the design
    n_places: int  # how many places of this scope were searched
    companions: NDArray[np.intp]  # columns of the static part that a calibration may have absorbed
    is_recalibration: bool = False  # nuisances hold the same within their priors
    in_means: float = 1.0  # of its mean square over taxels, that rows which are means of triangles show
    companion_words: tuple[str, ...] = ()
    companion_std: tuple[float, ...] = ()  # of their shares, for a share of 1 of the term

    @property
    def word(self) -> str:
        """Of its term."""
        return self.term.word

    def of_law(self) -> PlacedTerm:
        """The columns of its law, of those of the whole family."""
        own = [k for k, setting in enumerate(self.settings) if self.term.is_in_law(setting)]
        return replace(self, settings=tuple(self.settings[k] for k in own), columns=self.columns[own])

    def without(self, words: Collection[str]) -> PlacedTerm:
        """The same without companions of these `words`."""
        kept = [i for i, word in enumerate(self.companion_words) if word not in words]
        return replace(
            self, companions=self.companions[kept],
            companion_words=tuple(self.companion_words[i] for i in kept),
            companion_std=tuple(self.companion_std[i] for i in kept),
        )  # fmt: skip


class Gram(Protocol):
    """(p, p) inner products, indexed as an array is."""

    def __getitem__(self, index: Any, /) -> Any:
        """Those of rows and columns."""

    def diagonal(self) -> Array:
        """(p,)"""


class Regression(Protocol):
    """Candidates and their inner products, nuisances projected out: y the static model's residual, p columns."""

    @property
    def load(self) -> LoadEstimate:
        """What the columns were made of."""

    @property
    def weights(self) -> Array:
        """(N, c) one over the standard deviation of a row in each of c channels; 0: unknown."""

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
        """Squared sum of y."""

    @property
    def n_rows(self) -> int:
        """Rows with a weight, of one channel."""

    @property
    def least(self) -> Array:
        """(c,) squared sum, in variances of the noise, of the smallest effect worth a name, of each candidate."""

    def retimed(self, timing: Timing) -> Self:
        """Against the reference after `timing`."""

    def subset(self, chosen: Sequence[int]) -> Self:
        """With the columns of `chosen` candidates and their companions alone."""

    def exchanged(self, i: int, setting: Setting) -> Self:
        """With another setting of candidate `i`."""

    def of_laws(self) -> Self:
        """Without what the laws of its candidates leave out of real materials."""

    def of_families(self) -> Self:
        """The same, but with all columns of its candidates: a family may have more than the law of a model."""


def with_companions(every: Sequence[PlacedTerm], rest: Mapping[str, float] = NOTHING) -> tuple[PlacedTerm, ...]:
    """Terms that a calibration may have absorbed a static part of get the static columns of their place.

    `rest`: what memories have beside what `Term.absorbs` says.
    """
    static: dict[tuple[Where, str], list[int]] = {}
    for each in every:
        static.setdefault((each.where, each.word), each.columns.tolist())
    found = []
    for each in every:
        absorbs = {**rest, **each.term.absorbs} if each.term.is_memory else each.term.absorbs
        beside = [
            (column, word, std)
            for word, std in absorbs.items()
            for column in static.get((each.where, word), ())
        ]  # fmt: skip
        columns, words, stds = zip(*beside, strict=True) if beside else ((), (), ())
        found.append(
            replace(each, companions=np.array(columns, np.intp), companion_words=words, companion_std=stds)
        )  # fmt: skip
    return tuple(found)


D = TypeVar("D", bound=Regression)
