"""What a candidate is: a piece of physics that a diagnosis may find, in the form a search can afford.

A candidate acts on the load, on the regular grid it is given on, or brings columns that every taxel may have a share
of (what warmth or time adds to a count). Its law, its words and its units are those of `physics.effects`; only the
arithmetic is that of a search: whole signals at once on a regular grid instead of sample by sample.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..physics.law import Array


@dataclass(frozen=True, slots=True, eq=False)
class Excitation:
    """What the load of one recording is like, as far as candidates ask: their starts and grids follow from it."""

    span_pa: float  # from rest to the highest load
    two_speeds: bool  # it rises or falls at two clearly different speeds
    hold_s: float  # the longest stretch at one load, not at rest
    seconds: float
    temperature_span_k: float  # 0 where it is not recorded
    temperature_c: float  # on average
    temperature_reverses: bool
    reversals: int
    own_clock: bool


@dataclass(frozen=True, slots=True)
class Rows:
    """The blocks that columns are computed for, of one recording."""

    t_s: Array  # (n,)
    seconds: float  # the recording's
    temperature_c: Array | None  # (n,)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidate:
    """One piece of physics in a search: p parameters θ within bounds."""

    word: str
    order: int  # on the signal path
    names: tuple[str, ...] = ()  # of θ, in the search's own terms; none where columns are all there is
    low: Array = field(default_factory=lambda: np.empty(0))  # (p,)
    high: Array = field(default_factory=lambda: np.empty(0))  # (p,)
    # (s, p) where to begin; the best of them is chosen by what it would explain
    starts: Array = field(default_factory=lambda: np.empty((1, 0)))
    nudge: Array | None = None  # (p,) step of θ that shows a slope; None: a ten-thousandth of the bounds' distance
    # (N, m) load, s a row, θ → (N, m) what is left of it after the effect
    act: Callable[[Array, float, Array], Array] | None = None
    # rows, (n, m) effective load scaled to −1…1 → (n, k) or (n, m, k) columns
    columns: Callable[[Rows, Array], Array] | None = None
    own_columns: bool = False  # each recording has columns, and shares, of its own
    scatters: bool = False  # it acts on each taxel by more or less than on others (`strengths`)
    recordings: frozenset[int] | None = None  # in which it is at work; None: in all
    # θ → the parameters of the effect as the format has them; None: they are told from the columns' shares
    parameters: Callable[[Array], dict[str, Any]] | None = None
    other_word: Callable[[Array], str] | None = None  # θ → its word, where θ can make it another's
    needs: Callable[[Excitation], str | None] = lambda excitation: None  # what the data lack to tell it; None: nothing

    def works_in(self, recording: int) -> bool:
        """Whether it is at work in the recording of this number."""
        return self.recordings is None or recording in self.recordings

    def is_really(self, theta: Array) -> str:
        """The word for what these parameters say: a family's edge may be another family."""
        return self.word if self.other_word is None else self.other_word(theta)

    def __len__(self) -> int:
        """How many parameters it has."""
        return len(self.names)


def bounds(*limits: tuple[float, float]) -> tuple[Array, Array]:
    """(p,) lower and (p,) upper of pairs."""
    pairs = np.array(limits, float).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]
