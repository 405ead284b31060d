"""`hysteresis`: plays. q = (1 − Σ w_j)·P + Σ w_j·play_rj[P]; the inverse, from readings, is a sum of plays too.

There are plays, too, whose loop closes as the load vanishes, as between layers that the load presses together. Columns
of Dahl's friction are offered besides: after a turn it follows the load sooner than a play, and its limit may be
constant, grow with the load, or, from readings, be there as soon as there is a load. From readings, the inverse of one
friction is about a sum of frictions of other widths. The exported model contains only the plays; on a walk, those that
close only if they describe much more of a friction than the others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import chain, groupby
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from ...physics.law import MOST_SHARED, Array
from ..load_estimate import LoadEstimate
from ..operators import each_of, frictions, plays
from .term import ABSORBED, Setting, Term, TermColumns, geometric, joint_of_courses

UNEVEN = 0.5  # prior standard deviation of the companion `uneven_loops`
WIDEST = 0.4  # largest radius, relative to the range of the load
RADII_PA = geometric(3e3, 192e3, 7)
LEAST_WEIGHT = 2e-3  # of a play in the parameters
# Load, relative to its range, at which a loop that closes at zero is half as wide as under high loads.
HALF, HALF_ON_WALKS = 0.2, 1.0
LEAST_CLOSING = 0.04  # smallest radius of these plays on a walk, relative to its range; noise turns smaller ones
AT_ONCE = 0.01  # load at which a friction that is there as soon as there is a load has half its limit
TYPICAL = 0.5  # load of a closing play of readings, relative to its half load, at which its law has the same weights
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
    settings = load.wanted([{"r_pa": radius_pa} for radius_pa in radii_pa.tolist()])
    loops: Iterable[Array] = (-play for play in each_of(plays, flat, _radii_pa(settings)))
    if more is not None:
        further_settings, further_loops = more(load, radii_pa, flat)
        settings, loops = settings + further_settings, chain(loops, further_loops)
    return [joint_of_courses(load, settings, loops)]


def _closing_loops(load: LoadEstimate, radii_pa: Array, flat: Array) -> Loops:
    """Return closing plays of a known pressure, and frictions: constant, and growing with the load."""
    settings, plays = _closing_plays(load, flat, radii_pa, HALF * load.top_pa)
    friction_settings, friction_loops = _frictions(load, flat, [np.ones(1), flat / flat.max()])
    return settings + friction_settings, chain(plays, friction_loops)


def _frictions_of_readings(load: LoadEstimate, radii_pa: Array, flat: Array) -> Loops:
    """Return frictions of readings; limits with the noise of a reading would fit that noise."""
    held_pa = load.held_pa.reshape(flat.shape)
    closing = held_pa / (np.abs(held_pa) + AT_ONCE * load.top_pa)
    return _frictions(load, held_pa, [np.ones(1), held_pa / held_pa.max(), closing])


def _closing_plays_of_walk(load: LoadEstimate) -> TermColumns:
    """Return joint columns of a walk: plays of held readings that close at zero."""
    radii_pa = np.array([each for each in RADII_PA if each > LEAST_CLOSING * load.top_pa] or RADII_PA[-1:])
    held_pa = load.held_pa.reshape(len(load.held_pa), -1)
    return joint_of_courses(load, *_closing_plays(load, held_pa, radii_pa, HALF_ON_WALKS * load.top_pa))


def _closing_plays(load: LoadEstimate, pressure: Array, radii_pa: Array, half_pa: float) -> Loops:
    """Return plays of a pressure (N, m) whose loop closes at zero."""
    loaded = np.maximum(pressure, 0.0)
    part = loaded / (loaded + half_pa)
    settings = load.wanted([{"r_pa": radius_pa, "half_pa": half_pa} for radius_pa in radii_pa.tolist()])
    return settings, (-play * part for play in each_of(plays, loaded, _radii_pa(settings)))


def _frictions(load: LoadEstimate, pressure: Array, limits: Sequence[Array]) -> Loops:
    """Return frictions of a pressure (N, m) with all WIDTHS, times each of the `limits`, (N, m) or (1,)."""
    widths_pa = (load.top_pa * WIDTHS).tolist()
    settings = load.wanted(
        [{"up_pa": up, "down_pa": down, "limit": float(k)} for up, down in widths_pa for k in range(len(limits))]
    )
    by_width = [list(alike) for _, alike in groupby(settings, key=itemgetter("up_pa", "down_pa"))]
    used_pa = np.array([(alike[0]["up_pa"], alike[0]["down_pa"]) for alike in by_width]).reshape(-1, 2)
    constant = each_of(frictions, pressure, *used_pa.T)
    return settings, (
        friction * limits[int(each["limit"])]
        for friction, alike in zip(constant, by_width, strict=True) for each in alike
    )  # fmt: skip


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return radii, Pa, weights and, if any play closes, half loads of the law whose inverse has these shares.

    A closing play counts with its part under a TYPICAL load. If the weights then exceed their bound, the plays are
    wider, and the loop as wide as before. Source: K. Kuhnen, Eur. J. Control 9 (2003) 407.
    """
    radii, half_pa = _radii_and_halves(settings)
    part = np.where(half_pa > 0.0, TYPICAL / (TYPICAL + 1.0), 1.0)
    order = np.argsort(radii, kind="stable")
    b = (np.maximum(np.asarray(shares, float), 0.0) * part)[order]
    slopes = 1.0 + b.sum() - np.concatenate([[0.0], np.cumsum(b)])
    r_pa, w = np.cumsum(slopes[:-1] * np.diff(radii[order], prepend=0.0)), np.diff(1.0 / slopes) / part[order]
    wider = max(1.0, float(w.sum()) / MOST_SHARED)
    return _values(wider * r_pa, w / wider, half_pa[order])


def _known_parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Return radii, Pa, weights and, if any play closes, half loads: settings and shares if the load is known."""
    r_pa, half_pa = _radii_and_halves(settings)
    return _values(r_pa, np.maximum(np.asarray(shares, float), 0.0), half_pa)


def _radii_and_halves(settings: Sequence[Setting]) -> tuple[Array, Array]:
    """Return radii and half loads (k,), Pa; 0 for a play that does not close."""
    return _radii_pa(settings), np.array([one.get("half_pa", 0.0) for one in settings])


def _radii_pa(settings: Sequence[Setting]) -> Array:
    return np.array([one["r_pa"] for one in settings])


def _values(r_pa: Array, w: Array, half_pa: Array) -> dict[str, object]:
    """Return the values of plays whose weights are relevant; half loads only if any play closes."""
    kept = _relevant(w)
    values: dict[str, object] = {"r_pa": r_pa[kept].tolist(), "w": w[kept].tolist()}
    return {**values, "half_pa": half_pa[kept].tolist()} if half_pa[kept].any() else values


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
WITH_FRICTIONS = replace(
    TERM, scopes=("insole", "board"), columns=_columns_with_frictions, also_in_law=_closing_plays_of_walk
)
