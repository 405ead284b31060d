"""Define a law, its parameters, and the interface of the operators that apply it to samples.

An operator is called with consecutive pieces of a signal and keeps its state between them, so a recording in one piece
and a live signal sample by sample give the same numbers. The signal is assumed linear between its samples (first-order
hold), at any sampling times; for such a signal an operator is exact. Before the first sample, the signal is assumed to
have had the first sample's value for ever; memory of turning points (play, relay) starts unloaded.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from ..skin.layout import Layout

Array: TypeAlias = NDArray[np.float64]

# By name: a number is (1,) or (m,), a list (k, 1) or (k, m), a pair (2, 2); m are the taxels.
Values: TypeAlias = Mapping[str, Array]


@dataclass(frozen=True, slots=True)
class Moments:
    """Times of the samples of a piece, and the temperature at them."""

    t_s: Array  # (n,) since the origin of the effects' times
    dt_s: Array  # (n,) since the previous sample; 0 at the first one
    temperature_c: Array | None  # (n, 1) or (n, m)


@dataclass(frozen=True, slots=True)
class Site:
    """The part of an insole to which a law is applied."""

    layout: Layout
    xy_m: Array  # (n_triangles, 12, 2) true positions of the taxels, in the layout's order
    columns: NDArray[np.intp]  # (m,) slots: 12 · row of the triangle in the layout + taxel
    shift: NDArray[np.int64]  # (m,) configured shift of the boards; empty if no boards were given
    no_load: NDArray[np.int64]  # (m,) configured no-load of the boards; empty if no boards were given
    seed: int  # of all random draws


Operator: TypeAlias = Callable[[Array, Moments], Array]  # (n, m) of a piece → (n, m); must not change its argument
Maker: TypeAlias = Callable[[Values, Site], Operator]

# What a law maps: positions, Pa to Pa, Pa to baseline − count, activation to activation, count to count, time to time.
Domain: TypeAlias = Literal["place", "pressure", "curve", "activation", "count", "time"]

# What a law can be applied to; an id has as many numbers as the scope's index in SCOPES.
Scope: TypeAlias = Literal["insole", "board", "triangle", "taxel"]
SCOPES: tuple[Scope, ...] = get_args(Scope)


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a law."""

    name: str  # ends with the unit
    unit: str
    low: float  # inclusive bounds; beyond them the law is meaningless or has no inverse
    high: float
    prior: tuple[float, float]  # plausible range, searched first; far inside the bounds
    meaning: str
    size: Literal["one", "list", "pair"] = "one"
    whole: bool = False  # whether it must be an integer
    is_optional: bool = False  # whether it may be absent, for a list; `Values` are then without it


MOST_SHARED = 0.95  # largest total of delayed shares; without an immediate share the law has no inverse


def sum_problem(name: str, values: Values) -> tuple[str, str] | None:
    """Return the parameter and the problem if the shares in list `name` sum to more than MOST_SHARED."""
    total = float(values[name].sum(axis=0).max())
    if total <= MOST_SHARED + 1e-9:  # decimal fractions do not sum exactly
        return None
    return name, f"expected numbers whose sum is at most {MOST_SHARED:g}, found the sum {total:g}"


def unchanged(values: Values, site: Site) -> Operator:
    """Return an operator that changes nothing, for laws of positions and of time stamps."""
    return lambda x, moments: x


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """An effect as a physical law; each file in `effects/` defines one as LAW."""

    word: str
    order: int | None  # position on the signal path, as in the format's table; None: not on it
    domain: Domain
    equation: str
    source: str
    parameters: tuple[Parameter, ...]
    forward: Maker = unchanged
    inverse: Maker | None = unchanged  # causal
    inverse_is: str  # "exact", its error, or why there is none and what to do instead
    # Inverse for noisy readings, if `inverse` amplifies noise too much; None: use `inverse`.
    live: Maker | None = None
    # (m,) or (1,) remaining delay of a reading in s, after `live` or `inverse`.
    late_s: Callable[[Values], Array] = lambda values: np.zeros(1)
    needs_temperature: bool = False  # for the inverse as well
    scopes: tuple[Scope, ...] = SCOPES  # without "taxel", parameters cannot differ between taxels
    # Whether its operator gets all slots, not only those it is applied to (`Site.columns`).
    sees_all: bool = False
    # Checks values that are within their bounds jointly: returns the parameter's name and the problem, or None.
    find_problem: Callable[[Values], tuple[str, str] | None] = lambda values: None
    # True positions (n_triangles, 12, 2) in m of taxels whose layout positions are given.
    places: Callable[[Values, Array, Layout], Array] = lambda values, xy_m, layout: xy_m
    # Converts CAN times to reference times, in s.
    times: Callable[[Values, Array], Array] = lambda values, t_s: t_s

    def given(self, values: Mapping[str, object]) -> tuple[Parameter, ...]:
        """Return the parameters that have a value: all but optional ones that are absent."""
        return tuple(parameter for parameter in self.parameters if parameter.name in values)
