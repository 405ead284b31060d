"""What an effect is: a law with its parameters, and the operators that carry it out on samples.

An operator is called with consecutive pieces of a signal and keeps in itself what it must remember between them,
so a recording in one piece and a live signal sample by sample give the same numbers. The signal is taken as linear
between its samples (first-order hold), at whatever times they were taken; for such a signal an operator is exact.
Before the first sample the signal is taken to have been what the first sample is, for ever; memory of turning
points (play, relay) begins with no load.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from ..skin.layout import Layout

Array: TypeAlias = NDArray[np.float64]

# By name: one number is (1,) or (m,); a list (k, 1) or (k, m); a pair (2, 2). The axis of m is that of the taxels.
Values: TypeAlias = Mapping[str, Array]


@dataclass(frozen=True, slots=True)
class Moments:
    """When the samples of a piece were taken, and how warm it was then."""

    t_s: Array  # (n,) since the origin that the effects' own times count from
    dt_s: Array  # (n,) since the sample before, 0 at the very first
    temperature_c: Array | None  # (n, 1) or (n, m)


@dataclass(frozen=True, slots=True)
class Site:
    """Where on an insole a law is at work."""

    layout: Layout
    xy_m: Array  # (n_triangles, 12, 2) where the taxels lie that report in the layout's order
    columns: NDArray[np.intp]  # (m,) slots: 12 · row of the triangle in the layout + taxel
    shift: NDArray[np.int64]  # (m,) that the boards are believed to have; empty where no boards were named
    no_load: NDArray[np.int64]  # (m,) as `shift`
    seed: int  # of all that is left to chance


Operator: TypeAlias = Callable[[Array, Moments], Array]  # (n, m) of a piece → (n, m), its argument left as it was
Maker: TypeAlias = Callable[[Values, Site], Operator]

# Between what a law stands: the load's place, Pa and Pa, Pa and baseline − count, two of these, two counts, two times.
Domain: TypeAlias = Literal["place", "pressure", "curve", "activation", "count", "time"]

# What a law can be at work on; an id has as many numbers as the scope's place in this.
Scope: TypeAlias = Literal["insole", "board", "triangle", "taxel"]
SCOPES: tuple[Scope, ...] = get_args(Scope)


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a law."""

    name: str  # ends with the unit
    unit: str
    low: float  # the bounds, both allowed: beyond them the law makes no sense, or has no inverse
    high: float
    prior: tuple[float, float]  # what is plausible, to look in first; far inside the bounds
    meaning: str
    size: Literal["one", "list", "pair"] = "one"
    whole: bool = False  # a whole number


MOST_SHARED = 0.95  # of an answer: something has to come at once, or there is nothing to undo the rest by


def wrong_sum(name: str, values: Values) -> tuple[str, str] | None:
    """What is wrong with the shares of list `name` as a whole, for `Law.wrong`."""
    total = float(values[name].sum(axis=0).max())
    if total <= MOST_SHARED + 1e-9:  # decimal fractions do not sum exactly
        return None
    return name, f"expected numbers whose sum is at most {MOST_SHARED:g}, found the sum {total:g}"


def unchanged(values: Values, site: Site) -> Operator:
    """The maker of laws that leave every sample as it is: those of places and of time stamps."""
    return lambda x, moments: x


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """An effect as physics knows it; a file in `effects/` holds one, as LAW."""

    word: str
    order: int | None  # on the signal path, as in the format's table; None: beside it
    domain: Domain
    equation: str
    source: str
    parameters: tuple[Parameter, ...]
    forward: Maker = unchanged
    inverse: Maker | None = unchanged  # causal
    inverse_is: str  # "exact", or how far it is from that, or why there is none and what to do instead
    # Undoes it on readings, whose noise `inverse` makes too much of; None: `inverse` itself does.
    live: Maker | None = None
    # (m,) or (1,) s by which a reading is older than its stamp, once `live` or `inverse` has undone what it can.
    late_s: Callable[[Values], Array] = lambda values: np.zeros(1)
    needs_temperature: bool = False  # to be undone, too
    scopes: tuple[Scope, ...] = SCOPES  # without "taxel", a parameter has one value for all of them
    # Its operator is shown all slots, not only those it is at work on (`Site.columns`).
    sees_all: bool = False
    # What no single bound says of values that are within them: the parameter's name and what is wrong.
    wrong: Callable[[Values], tuple[str, str] | None] = lambda values: None
    # Where taxels lie that are believed to be at (n_triangles, 12, 2) m.
    places: Callable[[Values, Array, Layout], Array] = lambda values, xy_m, layout: xy_m
    # Reference seconds of CAN seconds.
    times: Callable[[Values, Array], Array] = lambda values, t_s: t_s
