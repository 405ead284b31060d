"""`hysteresis`: plays. q = (1 − Σ w_j)·P + Σ w_j·play_rj[P]; the inverse, from readings, is a sum of plays too.

If the load is known there are plays, too, whose loop closes as the load vanishes, as between layers that the load
presses together. Columns of Dahl's friction are offered besides: after a turn it follows the load sooner than a play,
and its limit may be constant, grow with the load, or, from readings, be there as soon as there is a load. From
readings, the inverse of one friction is about a sum of frictions of other widths. The exported model contains only the
plays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from ...physics.law import MOST_SHARED, Array
from ..load_estimate import LoadEstimate
from ..operators import each_play, frictions
from .term import ABSORBED, Setting, Term, TermColumns, geometric, stacked

UNEVEN = 0.5  # prior standard deviation of the companion `uneven_loops`
WIDEST = 0.4  # largest radius, relative to the range of the load
RADII_PA = geometric(3e3, 192e3, 7)
LEAST_WEIGHT = 2e-3  # of a play in the parameters
# Load, relative to its range, at which a loop that closes at zero is half as wide as under high loads.
HALF, HALF_ON_WALKS = 0.2, 0.01
# Widths of friction under rising and falling load, relative to its range: equal, or different by a factor 3.
WIDTHS = np.array([(0.02, 0.02), (0.06, 0.06), (0.18, 0.18), (0.02, 0.06), (0.06, 0.02), (0.06, 0.18), (0.18, 0.06)])


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return joint columns: q − play_r[q] for each radius, and, if the load is known, loops that close at zero."""
    return _joint_columns(load, _closing_loops if load.is_known else None)


def _columns_with_frictions(load: LoadEstimate) -> list[TermColumns]:
    """Return joint columns of a walk: q − play_r[q] for each radius, and frictions."""
    return [] if load.is_known else _joint_columns(load, _frictions_of_readings)


Loops = tuple[list[Setting], Iterable[Array]]  # settings, and what friction takes of the pressure (N, m), one by one


def _joint_columns(load: LoadEstimate, more: Callable[[LoadEstimate, Array, Array], Loops] | None) -> list[TermColumns]:
    """Return the columns of plays and, if given, those of `more` (load, radii in Pa, pressure (N, m))."""
    pressure = load.courses_pa
    radii_pa = np.array(RADII_PA)
    if load.is_known:  # a play of half the range never returns, so it would be a step in time
        radii_pa = radii_pa[radii_pa < WIDEST * float(np.ptp(pressure))]
        if not len(radii_pa):
            return []
    flat = pressure.reshape(len(pressure), -1)
    settings: list[Setting] = [{"r_pa": radius_pa} for radius_pa in radii_pa.tolist()]
    loops: Iterable[Array] = (-play for play in each_play(flat, radii_pa))
    if more is not None:
        further_settings, further_loops = more(load, radii_pa, flat)
        settings, loops = settings + further_settings, chain(loops, further_loops)
    wrenches = (load.wrench_of_courses(loop.reshape(pressure.shape)) for loop in loops)
    return [TermColumns(tuple(settings), by_triangle=stacked(wrenches, len(settings)), joint=True)]


def _closing_loops(load: LoadEstimate, radii_pa: Array, flat: Array) -> Loops:
    """Return plays of a known pressure that close at zero, and frictions: constant, and growing with the load."""
    half_pa = HALF * load.top_pa
    loaded = np.maximum(flat, 0.0)
    part = loaded / (loaded + half_pa)
    settings: list[Setting] = [{"r_pa": radius_pa, "half_pa": half_pa} for radius_pa in radii_pa.tolist()]
    friction_settings, friction_loops = _frictions(load, flat, [np.ones(1), flat / flat.max()])
    return settings + friction_settings, chain((-play * part for play in each_play(loaded, radii_pa)), friction_loops)


def _frictions_of_readings(load: LoadEstimate, radii_pa: Array, flat: Array) -> Loops:
    """Return frictions of readings; limits with the noise of a reading would fit that noise."""
    held_pa = load.held_pa.reshape(flat.shape)
    closing = held_pa / (np.abs(held_pa) + HALF_ON_WALKS * load.top_pa)
    return _frictions(load, held_pa, [np.ones(1), held_pa / held_pa.max(), closing])


def _frictions(load: LoadEstimate, pressure: Array, limits: Sequence[Array]) -> Loops:
    """Return frictions of a pressure (N, m) with all WIDTHS, times each of the `limits`, (N, m) or (1,)."""
    widths_pa = load.top_pa * WIDTHS
    settings: list[Setting] = [
        {"up_pa": up_pa, "down_pa": down_pa} for up_pa, down_pa in widths_pa.tolist() * len(limits)
    ]
    constant = frictions(pressure, *widths_pa.T)
    return settings, (friction * limit for limit in limits for friction in constant)


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return radii, Pa, and weights of the law whose inverse has these shares.

    Source: K. Kuhnen, Eur. J. Control 9 (2003) 407.
    """
    b = np.maximum(np.asarray(shares, float), 0.0)
    radii = np.array([setting["r_pa"] for setting in settings])
    slopes = 1.0 + b.sum() - np.concatenate([[0.0], np.cumsum(b)])
    widths = np.diff(radii, prepend=0.0)
    r_pa, w = np.cumsum(slopes[:-1] * widths), np.diff(1.0 / slopes)
    kept = _relevant(w)
    return {"r_pa": r_pa[kept].tolist(), "w": w[kept].tolist()}


def _known_parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return radii, Pa, weights and, if any play closes, half loads: settings and shares if the load is known."""
    w = np.maximum(np.asarray(shares, float), 0.0)
    kept = np.flatnonzero(_relevant(w)).tolist()
    values: dict[str, object] = {"r_pa": [settings[k]["r_pa"] for k in kept], "w": w[kept].tolist()}
    halves = [settings[k].get("half_pa", 0.0) for k in kept]
    return {**values, "half_pa": halves} if any(halves) else values


def _relevant(w: Array) -> NDArray[np.bool_]:
    """Return which weights (k,) are at least LEAST_WEIGHT; the largest always is one of them."""
    kept = w > LEAST_WEIGHT
    kept[np.argmax(w)] = True
    return kept


def _is_in_law(setting: Setting) -> bool:
    return "r_pa" in setting


TERM = Term(
    word="hysteresis",
    scopes=("insole", "board", "triangle"),
    share="positive",
    columns=_columns,
    parameters=_parameters,
    known_parameters=_known_parameters,
    plausible=0.1,
    limit=4.0,
    known_sum_bound=MOST_SHARED,
    absorbs={**ABSORBED, "uneven_loops": UNEVEN},
    is_in_law=_is_in_law,
    misfit=0.03,
)
# On a walk frictions are offered at large places only: the wrench does not show which law a triangle follows.
WITH_FRICTIONS = replace(TERM, scopes=("insole", "board"), columns=_columns_with_frictions)
