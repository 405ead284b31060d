"""`hysteresis`: plays. q = (1 − Σ w_j)·P + Σ w_j·play_rj[P]; the inverse, from readings, is a sum of plays too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...physics.law import MOST_SHARED, Array
from ..load_estimate import LoadEstimate
from ..operators import plays
from .term import ABSORBED, Setting, Term, TermColumns, geometric

UNEVEN = 0.5  # prior standard deviation of the companion `uneven_loops`
WIDEST = 0.4  # largest radius, relative to the range of the load
RADII_PA = geometric(3e3, 192e3, 7)
LEAST_WEIGHT = 2e-3  # of a play in the parameters


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Return joint columns: q − play_r[q] for each radius, computed from readings with reduced noise."""
    pressure = load.courses_pa
    radii_pa = RADII_PA
    if load.is_known:  # a play of half the range never returns, so it would be a step in time
        radii_pa = [r for r in RADII_PA if r < WIDEST * float(np.ptp(pressure))]
        if not radii_pa:
            return []
    flat = pressure.reshape(len(pressure), -1)
    loops = (-plays(flat, np.array([radius_pa]))[0].reshape(pressure.shape) for radius_pa in radii_pa)
    columns = [load.wrench_of_courses(loop) for loop in loops]
    return [TermColumns(tuple({"r_pa": r} for r in radii_pa), by_triangle=np.stack(columns, axis=-1), joint=True)]


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
    misfit=0.03,
)
