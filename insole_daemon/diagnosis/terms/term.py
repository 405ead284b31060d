"""What a term is: an effect as columns of a regression on the wrench."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ...physics.effects import laws
from ...physics.law import Array, Scope
from ..load_estimate import LoadEstimate

Setting = Mapping[str, float]  # non-linear parameters by name

LEAST_SIZE = 0.15  # smallest effect: RMS over its taxels, in the noise of a reading


@dataclass(frozen=True, slots=True, eq=False)
class TermColumns:
    """k columns of one term: what it changes of the wrench, as load − what the static curves say, for a share of 1.

    `by_triangle` (N, T, 3, k) where the term can be at work on a part of the insole, else `whole` (N, 3, k). With
    `joint`, all columns enter together; otherwise each is a candidate of its own.
    """

    settings: tuple[Setting, ...]
    by_triangle: Array | None = None
    whole: Array | None = None
    joint: bool = False
    # Noise of the rows comes back in some columns, and averaging it would pass for an effect: its mean product with
    # the residual's noise, and its mean square, shaped as the columns.
    echo: tuple[Array, Array] | None = None
    places: tuple[tuple[tuple[int, ...], ...], ...] | None = None  # of each column, where the column says it itself
    n_searched: int = 0  # places, of which `places` are the likeliest; 0: all stand there
    in_means: float = 1.0  # of the mean square of what it moves taxels by, that means of triangles show
    # The base terms hold the same within their priors: a recalibration. Judged by its whole size, not by what is left
    # of it once the base has absorbed its part.
    is_recalibration: bool = False


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Term:
    """An effect in the regression.

    `share`: "positive" (shares are at least 0), "free", or "whole" (the effect is there as it is, or not at all).
    `misfit`: mean square share of the effect that its columns may fail to describe, because real materials follow the
    law only approximately.
    """

    word: str
    scopes: tuple[Scope, ...]
    share: Literal["positive", "free", "whole"]
    columns: Callable[[LoadEstimate], Sequence[TermColumns]]
    # Of the law, from settings and shares (k,); of columns computed from readings, and from a load that is known.
    parameters: Callable[[Sequence[Setting], Array], dict[str, object]]
    known_parameters: Callable[[Sequence[Setting], Array], dict[str, object]] | None = None
    # A calibration made with it at work contains a static part of it: words of that part, and the standard deviation
    # of each one's share, for a share of 1.
    absorbs: Mapping[str, float] = field(default_factory=dict)
    limit: float = np.inf  # of a share's size: beyond it the law makes no sense
    known_most: float = np.inf  # of the sum of its shares where the load is known: they are the law's own
    misfit: float = 0.002
    likeness: float = 1.0  # share of what other laws miss that it may take: less, where it has a course of its own
    known_misfit: float | None = None  # where the load is known, and columns are made of it and not of readings
    is_of_load: bool = False  # columns are the law's own, though the load of single taxels is not known
    is_internal: bool = False  # beside others only, never named, and in no model
    acts_at: int | None = None  # on the signal path, of a term that has no law
    yields_to: tuple[str, ...] = ()  # terms that are likelier by themselves, where they explain nearly as much
    refine: tuple[str, ...] = ()  # settings that are refined once the term is selected
    linear_at: str = ""  # the setting that says at which share the columns are taken, where they are not linear
    column: Callable[[LoadEstimate, Setting], TermColumns] | None = None  # of one setting, to refine it
    chamber_scopes: tuple[Scope, ...] = ()  # further ones where the load is the same on all taxels
    plausible: float = 0.0  # a typical share, as literature and data sheets have it; 0: not asked
    # Whether the law makes sense with settings and shares (k,), of a load that is known or not, beyond `limit`.
    is_possible: Callable[[Sequence[Setting], Array, bool], bool] = lambda settings, shares, load_is_known: True
    # Whether a column is the law's own; others describe what real materials do, and are in no model.
    is_in_law: Callable[[Setting], bool] = lambda setting: True
    record_instead: str = ""  # what shows it; empty: a load that is known on every taxel, at several speeds
    needs: Callable[[LoadEstimate], str | None] = lambda load: None  # why a recording cannot show it

    @property
    def is_memory(self) -> bool:
        """Whether a calibration made with it at work contains its mean curve."""
        return self.is_of_load or all(self.absorbs.get(word) == std for word, std in ABSORBED.items())

    @property
    def is_loop(self) -> bool:
        """Whether readings depend on the load before: memories, and taxels that snap."""
        return self.is_memory or self.word == "snap"

    @property
    def order(self) -> int | None:
        """Its place on the signal path (formats.md); None: beside it."""
        law = laws().get(self.word)
        return self.acts_at if law is None else law.order

    def placed_columns(self, load: LoadEstimate) -> Sequence[TermColumns]:
        """Its columns under the load that the terms before it on the signal path leave."""
        return self.columns(load.before(self.order))

    def column_of(self, load: LoadEstimate, setting: Setting) -> TermColumns:
        """The same, of one setting."""
        assert self.column is not None
        return self.column(load.before(self.order), setting)

    def shown_by(self, load: LoadEstimate) -> str:
        """What to record where a recording under `load` does not show it."""
        if needs_calibration(load) is not None and self.needs is needs_calibration:
            return "a calibration of this insole (insole calibrate), and diagnose against that"
        if self.record_instead:
            return self.record_instead
        return SPEEDS if load.is_known else f"the insole in a chamber, where the load is known on every taxel: {SPEEDS}"

    def misfit_of(self, load_is_known: bool) -> float:
        """What its columns may fail to describe of it."""
        return self.known_misfit if load_is_known and self.known_misfit is not None else self.misfit

    def most(self, load_is_known: bool) -> float:
        """Of the sum of its shares."""
        return self.known_most if load_is_known or self.is_of_load else np.inf

    def parameters_of(self, load_is_known: bool) -> Callable[[Sequence[Setting], Array], dict[str, object]]:
        """The law's parameters from settings and shares (k,)."""
        return self.known_parameters if load_is_known and self.known_parameters is not None else self.parameters


def in_means(load: LoadEstimate, moved_pa: Array) -> float:
    """Share of the mean square of `moved_pa` (N, T, 12) that means of triangles show."""
    usable = load.observation.usable
    means = load.wrench_of(moved_pa)[..., 0][..., None]
    whole = float(np.sum(moved_pa**2 * usable))
    return min(float(np.sum(means**2 * usable)) / whole, 1.0) if whole > 0 else 1.0


SPEEDS = "cycles at two speeds, minor loops and holds of a minute, loaded and unloaded"
EVERY_S, KNOWN_EVERY_S = 3.0, 5.0  # between moments
EDGE_S = 3.0  # an event at the very beginning or end shows too little
ABSORBED = {"gain": 0.5, "stiffening": 0.5}  # by a memory whose shares are shares of the answer


def geometric(low: float, high: float, number: int) -> list[float]:
    """`number` values from `low` to `high` in equal ratios."""
    found: list[float] = np.geomspace(low, high, number).tolist()
    return found


def moments_s(load: LoadEstimate) -> list[float]:
    """At which an event is looked for; where the load is known, the best of them is sharpened (`select.events`)."""
    t_s = load.observation.t_s
    found: list[float] = np.arange(
        t_s[0] + EDGE_S, t_s[-1] - EDGE_S, KNOWN_EVERY_S if load.is_known else EVERY_S
    ).tolist()
    return found


def needs_calibration(load: LoadEstimate) -> str | None:
    """Why nothing of a static curve can be told where the curves are fitted to the recordings themselves."""
    if not load.observation.has_own_curves:
        return None
    return "no calibration was handed in: the curves are those that fit these recordings best"
