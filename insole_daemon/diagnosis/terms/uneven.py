"""Companions of memories for the misfit of their laws: real memories are stronger at some loads than at others.

The columns are the operators of the memories on the load of each third of its range. Plays of one third describe
Preisach loops whose thresholds lie in it (Mayergoyz, Mathematical models of hysteresis, 1991). Low passes of one third
describe materials whose creep depends on the load. The prior of the shares is proportional to those of the memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import chain

import numpy as np

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..operators import each_of, low_pass, plays
from .creep import TERM as CREEPS
from .hysteresis import TERM as HYSTERESIS
from .term import Term, TermColumns, joint_of_courses, needs_known_load

PARTS = 3  # of the range of the load
RADII = (0.02, 0.06, 0.15)  # of plays, relative to the range
TAUS_S = (1.0, 8.0, 60.0)
WIDTHS = (0.03, 0.1, 0.3)  # of frictions, relative to the range


def _plays(load: LoadEstimate) -> list[TermColumns]:
    """Return joint columns: load of a part − its play, for each part and radius, and earlier frictions' decay."""
    top = float(load.courses_pa.max())
    settings = [{"part": float(k), "r_pa": radius * top} for k in range(PARTS) for radius in RADII]
    radii_pa = top * np.array(RADII)
    flat = (_part_of(load, k).reshape(len(load.courses_pa), -1) for k in range(PARTS))
    loops: Iterable[Array] = (-play for part in flat for play in each_of(plays, part, radii_pa))
    if load.observation.is_uniform:  # of each taxel alone they would take long
        widths_pa = top * np.array(WIDTHS)
        settings += [{"width_pa": width} for width in widths_pa]
        loops = chain(loops, _earlier_frictions(load.courses_pa, widths_pa))
    return [joint_of_courses(load, settings, loops)]


def _earlier_frictions(pressure: Array, widths_pa: Array) -> Iterator[Array]:
    """Yield the decay of a friction that was present before the first row, for each width."""
    way = np.cumsum(np.abs(np.diff(pressure, axis=0, prepend=pressure[:1])), axis=0)
    for width in widths_pa:
        yield width * np.exp(-way / width)


def _late(load: LoadEstimate) -> list[TermColumns]:
    """Return joint columns: low or high minus middle part of the load, minus its low pass, for each time constant."""
    settings = [{"part": float(k), "tau_s": tau_s} for k in range(PARTS - 1) for tau_s in TAUS_S]
    middle = PARTS // 2
    differences = (_part_of(load, k) - _part_of(load, middle) for k in range(PARTS) if k != middle)
    late = (_behind(part, load.step_s, tau_s) for part in differences for tau_s in TAUS_S)
    return [joint_of_courses(load, settings, late)]


def _behind(pressure: Array, step_s: float, tau_s: float) -> Array:
    """Return pressure − its low pass, for pressures of any shape (N, ...)."""
    return pressure - low_pass(pressure.reshape(len(pressure), -1), step_s, tau_s).reshape(pressure.shape)


def _part_of(load: LoadEstimate, k: int) -> Array:
    """Return the load within part `k` of its range; the sum of all PARTS is the load."""
    pressure = load.courses_pa
    low, high = np.linspace(0.0, float(pressure.max()), PARTS + 1)[k : k + 2]
    part = np.clip(pressure, low, high)
    part -= low
    return part


def _term(word: str, acts_at: int | None, columns: Callable[[LoadEstimate], list[TermColumns]]) -> Term:
    return Term(
        word=word,
        acts_at=acts_at,
        scopes=("insole", "board", "triangle"),
        share="free",
        columns=columns,
        parameters=lambda settings, shares: {},  # never reported
        needs=needs_known_load,
        is_internal=True,
    )


LOOPS = _term("uneven_loops", HYSTERESIS.order, _plays)
CREEP = _term("uneven_creep", CREEPS.order, _late)
