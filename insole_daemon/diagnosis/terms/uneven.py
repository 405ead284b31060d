"""What real memories have that the laws have not: more of it at low loads than at high, or of another width.

The same operators, on the load cut at thirds of its range. Plays of these span the loops of Preisach whose thresholds
lie in one third each (Mayergoyz, Mathematical models of hysteresis, 1991); late parts of these, materials that creep
faster the more they bear. Beside a memory, as large as a share of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, pairwise

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..operators import frictions, low_pass, plays
from .creep import TERM as CREEPS
from .hysteresis import TERM as HYSTERESIS
from .term import Setting, Term, TermColumns

PARTS = 3  # of the range
RADII = (0.02, 0.06, 0.15)  # of the range
TAUS_S = (1.0, 8.0, 60.0)
WIDTHS = (0.03, 0.1, 0.3)  # of the range


def _plays(load: LoadEstimate) -> list[TermColumns]:
    """Joint columns: cut load − its play, for each part and radius; under a uniform load frictions, too."""
    top = float(load.courses_pa.max())
    settings = [{"part": float(k), "r_pa": radius * top} for k in range(PARTS) for radius in RADII]
    loops = (-_play(cut, radius * top) for cut in _cut(load) for radius in RADII)
    if load.observation.is_uniform:  # of a simulated load courses are guesses, and turn round at other moments
        widths_pa = top * np.array(WIDTHS)
        settings += [{"width_pa": width} for width in [*widths_pa, *-widths_pa]]
        return _joint(load, settings, chain(loops, _frictions(load.courses_pa, widths_pa)))
    return _joint(load, settings, loops)


def _play(pressure: Array, radius_pa: float) -> Array:
    """Play less pressure, of any shape (N, ...)."""
    own = plays(pressure.reshape(len(pressure), -1), np.array([radius_pa]))[0]
    return np.asarray(own.reshape(pressure.shape))


def _frictions(pressure: Array, widths_pa: Array) -> Iterator[Array]:
    """What friction takes of the pressure, for each width, and what of a friction before the first row dies away."""
    whole = pressure.reshape(len(pressure), -1)
    way = np.cumsum(np.abs(np.diff(whole, axis=0, prepend=whole[:1])), axis=0)
    for column in (*-frictions(whole, widths_pa), *(width * np.exp(-way / width) for width in widths_pa)):
        yield column.reshape(pressure.shape)


def _late(load: LoadEstimate) -> list[TermColumns]:
    """Joint columns: difference of the load's parts − what follows it late, for each time constant."""
    settings = [{"part": float(k), "tau_s": tau_s} for k in range(PARTS - 1) for tau_s in TAUS_S]
    low, middle, high = _cut(load)
    parts = (part - middle for part in (low, high))
    return _joint(load, settings, (_behind(part, load.step_s, tau_s) for part in parts for tau_s in TAUS_S))


def _behind(pressure: Array, step_s: float, tau_s: float) -> Array:
    """Pressure less what follows it late, of any shape (N, ...)."""
    return pressure - low_pass(pressure.reshape(len(pressure), -1), step_s, tau_s).reshape(pressure.shape)


def _cut(load: LoadEstimate) -> list[Array]:
    """The load of each part of the range."""
    pressure = load.courses_pa
    edges = np.linspace(0.0, float(pressure.max()), PARTS + 1)
    return [np.clip(pressure, low, high) - low for low, high in pairwise(edges)]


def _joint(load: LoadEstimate, settings: Sequence[Setting], columns: Iterable[Array]) -> list[TermColumns]:
    found = [load.wrench_of_courses(each) for each in columns]
    return [TermColumns(tuple(settings), by_triangle=np.stack(found, axis=-1), joint=True)]


def _needs(load: LoadEstimate) -> str | None:
    """Why a recording cannot show it."""
    return None if load.is_known else "the load of single taxels is not known"


def _term(word: str, acts_at: int | None, columns: Callable[[LoadEstimate], list[TermColumns]]) -> Term:
    return Term(
        word=word,
        acts_at=acts_at,
        scopes=("insole", "board", "triangle"),
        share="free",
        columns=columns,
        parameters=lambda settings, shares: {},  # it is what the law leaves out
        needs=_needs,
        is_internal=True,
    )


LOOPS = _term("uneven_loops", HYSTERESIS.order, _plays)
CREEP = _term("uneven_creep", CREEPS.order, _late)
