"""A term: an effect as columns (regressors) of the regression.

Columns are computed from the load and from settings of the law's non-linear parameters. The fitted coefficient of a
column is called its share.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Literal

import numpy as np

from ...physics.effects import laws
from ...physics.law import Array, Scope
from ..load_estimate import LoadEstimate

Setting = Mapping[str, float]  # non-linear parameters by name

NEAR_ONE = (0.65, 1.5)  # range of the share of a law that has no share, between the settings of its columns
LEAST_SIZE = 0.15  # smallest effect: RMS over its taxels, in the noise of a reading


@dataclass(frozen=True, slots=True, eq=False)
class TermColumns:
    """k columns of one term: its change of the load minus the reading by the static curves, for a share of 1.

    `by_triangle` (N, T, c, k) for a term that can act on a part of the insole, else `whole` (N, c, k). The c channels
    are f_z, m_x and m_y, or the mean pressure of a triangle where the load is known. With `joint`, all columns enter
    together; otherwise each is a candidate of its own.
    """

    settings: tuple[Setting, ...]
    by_triangle: Array | None = None
    whole: Array | None = None
    joint: bool = False
    # Noise echo, shaped as the columns: mean product of the noise in a column with that of the residual, and its mean
    # square. A column that contains the noise of the rows would otherwise explain that noise.
    echo: tuple[Array, Array] | None = None
    places: tuple[tuple[tuple[int, ...], ...], ...] | None = None  # triangles of each column, if they differ
    n_searched: int = 0  # number of places of which `places` are the most likely; 0: `places` are all
    in_means: float = 1.0  # mean square of the changed pressure in triangle means, relative to that over taxels
    # Within their priors, nuisance columns explain the same. The term is judged by its full size, not by the remainder
    # after the nuisance columns are projected out.
    is_recalibration: bool = False


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Term:
    """An effect in the regression.

    `share`: "positive" (shares are at least 0), "free" (of either sign), or "whole" (every share is 1). `misfit`:
    fraction of the effect's mean square that its columns may fail to describe, because real materials follow the law
    only approximately.
    """

    word: str
    scopes: tuple[Scope, ...]
    share: Literal["positive", "free", "whole"]
    columns: Callable[[LoadEstimate], Iterable[TermColumns]]  # one after the other: columns are large
    # Parameters of the law from settings and shares (k,), the first function for columns computed from readings, the
    # second, if it differs, for columns computed from a known load.
    parameters: Callable[[Sequence[Setting], Array], dict[str, object]]
    known_parameters: Callable[[Sequence[Setting], Array], dict[str, object]] | None = None
    # A calibration made while the effect acted contains a static part of it: the words of the terms that describe this
    # part, with the prior standard deviation of their shares per share of the effect.
    absorbs: Mapping[str, float] = field(default_factory=dict)
    limit: float = np.inf  # largest absolute share for which the law is valid
    known_sum_bound: float = np.inf  # largest sum of shares if the load is known: they are then the law's parameters
    wide_sum_bound: float | None = None  # the same of an unusual material; None: no other
    misfit: float = 0.002
    likeness: float = 1.0  # fraction of other laws' misfit that it can describe
    known_misfit: float | None = None  # `misfit` of columns computed from a known load; None: the same
    is_of_load: bool = False  # shares are the law's parameters even if the load is not known
    is_of_readings: bool = False  # columns depend on the readings alone, not on their load
    is_of_reference: bool = False  # columns are computed from the reference, and move with its clock and a lag
    is_internal: bool = False  # only a companion of other terms: never reported as an effect
    acts_at: int | None = None  # place on the signal path of a term without a law
    yields_to: tuple[str, ...] = ()  # terms that are preferred if they explain nearly as much
    refine: tuple[str, ...] = ()  # settings that are refined after selection
    linear_at: str = ""  # setting with the share at which a non-linear column is linearised
    column: Callable[[LoadEstimate, Setting], TermColumns] | None = None  # computes the column of one setting
    plausible: float = 0.0  # typical share by literature and data sheets; 0: unknown
    # Whether settings and shares (k,) are valid for the law, beside `limit`; the last argument: the load is known.
    is_possible: Callable[[Sequence[Setting], Array, bool], bool] = lambda settings, shares, load_is_known: True
    # Whether a column belongs to the law; others describe how real materials deviate from it, and are not exported.
    is_in_law: Callable[[Setting], bool] = lambda setting: True
    # Joint columns that the search does not have: the exported law has them if it then explains much more.
    also_in_law: Callable[[LoadEstimate], TermColumns] | None = None
    record_instead: str = ""  # recording that shows the effect; empty: a known load at several speeds
    needs: Callable[[LoadEstimate], str | None] = lambda load: None  # reason why a recording cannot show the effect

    # Whether a calibration made while the effect acted contains its mean curve.
    is_memory: bool = field(init=False)

    def __post_init__(self) -> None:
        absorbs_usual = all(self.absorbs.get(word) == std for word, std in ABSORBED.items())
        object.__setattr__(self, "is_memory", self.is_of_load or absorbs_usual)  # frozen

    @property
    def is_of_material(self) -> bool:
        """Return whether its strength is one of the material, which differs from triangle to triangle."""
        return self.is_memory or self.word == "temperature"

    @property
    def is_loop(self) -> bool:
        """Return whether readings depend on earlier loads: a memory, or a snap."""
        return self.is_memory or self.word == "snap"

    @property
    def order(self) -> int | None:
        """Return the place on the signal path (table of effects in formats.md); None: not on it."""
        law = laws().get(self.word)
        return self.acts_at if law is None else law.order

    def placed_columns(self, load: LoadEstimate) -> Iterable[TermColumns]:
        """Return the columns under the load as the terms before this one on the signal path have changed it."""
        if self.is_of_readings:
            kept: dict[str, tuple[TermColumns, ...]] = load.observation.columns_of_readings
            if self.word not in kept:
                kept[self.word] = tuple(self.columns(load))
            return kept[self.word]
        return self.columns(load.before(self.order))

    def column_of(self, load: LoadEstimate, setting: Setting) -> TermColumns:
        """Return the columns of one setting, under the same load as `placed_columns`."""
        assert self.column is not None
        return self.column(load.before(self.order), setting)

    def shown_by(self, load: LoadEstimate) -> str:
        """Return what to record if a recording under `load` does not show the effect, as part of a message."""
        if needs_calibration(load) is not None and self.needs is needs_calibration:
            return "a calibration of this insole (insole calibrate), and diagnose against that"
        if self.record_instead:
            return self.record_instead
        return SPEEDS if load.is_known else f"the insole in a chamber, where the load is known on every taxel: {SPEEDS}"

    def misfit_of(self, load_is_known: bool) -> float:
        """Return the fraction of the effect's mean square that its columns may fail to describe."""
        return self.known_misfit if load_is_known and self.known_misfit is not None else self.misfit

    def sum_bound(self, load_is_known: bool) -> float:
        """Return the upper bound of the sum of its shares."""
        return self.known_sum_bound if load_is_known or self.is_of_load else np.inf

    def with_wide_bound(self) -> Term:
        """Return the term with the bound of an unusual material."""
        return self if self.wide_sum_bound is None else replace(self, known_sum_bound=self.wide_sum_bound)

    def parameters_of(self, load_is_known: bool) -> Callable[[Sequence[Setting], Array], dict[str, object]]:
        """Return the function from settings and shares (k,) to the law's parameters."""
        return self.known_parameters if load_is_known and self.known_parameters is not None else self.parameters


def stacked(columns: Iterable[Array], n: int) -> Array:
    """Return `n` columns of equal shape (...) as (..., n), without holding all of them twice."""
    given = iter(columns)
    first = next(given)
    together = np.empty((*first.shape, n), first.dtype)
    for k, column in enumerate(chain([first], given)):
        together[..., k] = column
    return together


def joint_of_courses(load: LoadEstimate, settings: Sequence[Setting], courses: Iterable[Array]) -> TermColumns:
    """Return joint columns of pressures that can be shaped as `courses_pa`; they are made one after the other."""
    wrenches = (load.wrench_of_courses(course.reshape(load.courses_pa.shape)) for course in courses)
    return TermColumns(tuple(settings), by_triangle=stacked(wrenches, len(settings)), joint=True)


def in_means(load: LoadEstimate, moved_pa: Array) -> float:
    """Return the mean square of `moved_pa` (N, T, 12) in triangle means, relative to that over taxels, at most 1."""
    usable = load.observation.usable
    means = load.wrench_of(moved_pa)[..., 0][..., None]
    whole = float(np.sum(moved_pa**2 * usable))
    return min(float(np.sum(means**2 * usable)) / whole, 1.0) if whole > 0 else 1.0


SPEEDS = "cycles at two speeds, minor loops and holds of a minute, loaded and unloaded"
EVERY_S, KNOWN_EVERY_S = 3.0, 5.0  # between possible times of an event, if the load is unknown or known
EDGE_S = 3.0  # from the ends of a recording, where too few rows show an event
# `absorbs` of memories whose shares are fractions of the response. The mean curve is what gain and stiffening leave.
ABSORBED = {"gain": 0.5, "stiffening": 0.5, "mean_curve": 0.15}


def near_one(name: str, linear_up_to: float) -> Callable[[Sequence[Setting], Array, bool], bool]:
    """Return `is_possible` for a law without a share: under a known load that of its column is about 1.

    A column is linear in its setting `name` up to `linear_up_to`, so it may have any smaller share there. Otherwise a
    large delay with half a share would imitate other laws.
    """

    def is_possible(settings: Sequence[Setting], shares: Array, load_is_known: bool) -> bool:
        least = 0.0 if settings[0][name] <= linear_up_to else NEAR_ONE[0]
        return not load_is_known or bool(least <= shares[0] <= NEAR_ONE[1])

    return is_possible


def geometric(low: float, high: float, number: int) -> list[float]:
    """Return `number` values from `low` to `high` in equal ratios."""
    values: list[float] = np.geomspace(low, high, number).tolist()
    return values


def moments_s(load: LoadEstimate) -> list[float]:
    """Return the times at which an event is looked for; `select.events` refines the best if the load is known."""
    t_s = load.observation.t_s
    times_s: list[float] = np.arange(
        t_s[0] + EDGE_S, t_s[-1] - EDGE_S, KNOWN_EVERY_S if load.is_known else EVERY_S
    ).tolist()
    return times_s


def needs_calibration(load: LoadEstimate) -> str | None:
    """Return why no static effect can be identified if the curves were fitted to the recordings; None: it can."""
    if not load.observation.has_own_curves:
        return None
    return "no calibration was handed in: the curves are those that fit these recordings best"


def needs_known_load(load: LoadEstimate) -> str | None:
    """Return the reason why no term of single taxels' loads can be identified if these are unknown; None: it can."""
    return None if load.is_known else "the load of single taxels is not known"
