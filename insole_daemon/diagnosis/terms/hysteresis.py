"""`hysteresis`: plays. q = (1 − Σ w_j)·P + Σ w_j·play_rj[P]; the inverse, from readings, is a sum of plays too.

Columns of Dahl's friction are offered too: after a turn it follows the load sooner than a play, and its limit may grow
with the load, as between layers that the load presses together, or, on a walk, be there as soon as there is a load.
From readings, the inverse of one friction is about a sum of frictions of other widths. The exported model contains only
the plays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...physics.law import MOST_SHARED, Array
from ..load_estimate import LoadEstimate
from ..operators import frictions, plays
from .term import ABSORBED, Setting, Term, TermColumns, geometric

UNEVEN = 0.5  # prior standard deviation of the companion `uneven_loops`
WIDEST = 0.4  # largest radius, relative to the range of the load
RADII_PA = geometric(3e3, 192e3, 7)
LEAST_WEIGHT = 2e-3  # of a play in the parameters
CLOSING = 0.01  # load, relative to its range, at which a loop that closes at zero is half as wide as under high loads
# Widths of friction under rising and falling load, relative to its range: equal, or different by a factor 3.
WIDTHS = np.array([(0.02, 0.02), (0.06, 0.06), (0.18, 0.18), (0.02, 0.06), (0.06, 0.02), (0.06, 0.18), (0.18, 0.06)])


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return joint columns: q − play_r[q] for each radius, and frictions under a uniform load.

    A simulated load turns round at other times than the real one.
    """
    return _joint_columns(load, with_frictions=load.observation.is_uniform)


def _columns_with_frictions(load: LoadEstimate) -> list[TermColumns]:
    """Return joint columns of a walk: q − play_r[q] for each radius, and frictions."""
    return [] if load.is_known else _joint_columns(load, with_frictions=True)


def _joint_columns(load: LoadEstimate, with_frictions: bool) -> list[TermColumns]:
    pressure = load.courses_pa
    radii_pa = RADII_PA
    if load.is_known:  # a play of half the range never returns, so it would be a step in time
        radii_pa = [r for r in RADII_PA if r < WIDEST * float(np.ptp(pressure))]
        if not radii_pa:
            return []
    flat = pressure.reshape(len(pressure), -1)
    settings: list[Setting] = [{"r_pa": radius_pa} for radius_pa in radii_pa]
    loops = [-plays(flat, np.array([radius_pa]))[0] for radius_pa in radii_pa]
    if with_frictions:
        widths_pa = load.top_pa * WIDTHS
        held_pa = load.held_pa.reshape(flat.shape)  # limits with the noise of a reading would fit that noise
        constant = frictions(held_pa, *widths_pa.T)
        limits = [np.ones(1), held_pa / held_pa.max()]
        if not load.is_known:
            limits.append(held_pa / (np.abs(held_pa) + CLOSING * load.top_pa))
        settings += [{"up_pa": up_pa, "down_pa": down_pa} for up_pa, down_pa in widths_pa.tolist() * len(limits)]
        loops += [friction * limit for limit in limits for friction in constant]
    columns = [load.wrench_of_courses(loop.reshape(pressure.shape)) for loop in loops]
    return [TermColumns(tuple(settings), by_triangle=np.stack(columns, axis=-1), joint=True)]


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
    """Return radii, Pa, and weights, which are settings and shares themselves if the load is known."""
    w = np.maximum(np.asarray(shares, float), 0.0)
    kept = _relevant(w)
    return {"r_pa": [s["r_pa"] for s, yes in zip(settings, kept, strict=True) if yes], "w": w[kept].tolist()}


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
