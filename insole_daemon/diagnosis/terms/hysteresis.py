"""`hysteresis`: plays. q = (1 − Σ w_j)·P + Σ w_j·play_rj[P]; undone on readings it is a sum of plays again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import MOST_SHARED, Array
from ..load_estimate import LoadEstimate
from ..operators import plays
from .term import ABSORBED, Setting, Term, TermColumns, geometric

UNEVEN = 0.5
WIDEST = 0.4  # of the range of the load
RADII_PA = geometric(3e3, 192e3, 7)


def _columns(load: LoadEstimate) -> list[TermColumns]:
    """Joint columns: q − play_r[q] for each radius, on readings with noise reduced."""
    pressure = load.courses_pa
    radii_pa = RADII_PA
    if load.is_known:  # a play of half the range does not come back: that is a step in time, and no loop
        radii_pa = [r for r in RADII_PA if r < WIDEST * float(np.ptp(pressure))]
    flat = pressure.reshape(len(pressure), -1)
    loops = (-plays(flat, np.array([radius_pa]))[0].reshape(pressure.shape) for radius_pa in radii_pa)
    found = [load.wrench_of_courses(each) for each in loops]
    return [TermColumns(tuple({"r_pa": r} for r in radii_pa), by_triangle=np.stack(found, axis=-1), joint=True)]


def _parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Radii and weights of the law whose inverse has these shares (Kuhnen, Eur. J. Control 9 (2003) 407)."""
    b = np.maximum(np.asarray(shares, float), 0.0)
    radii = np.array([setting["r_pa"] for setting in settings])
    slopes = 1.0 + b.sum() - np.concatenate([[0.0], np.cumsum(b)])
    widths = np.diff(radii, prepend=0.0)
    r_pa, w = np.cumsum(slopes[:-1] * widths), np.diff(1.0 / slopes)
    kept = w > 2e-3
    kept[np.argmax(w)] = True
    return {"r_pa": r_pa[kept].tolist(), "w": w[kept].tolist()}


def _known_parameters(settings: Sequence[Setting], shares: Array) -> dict[str, object]:
    """Radii and weights of the law, whose columns these are."""
    w = np.maximum(np.asarray(shares, float), 0.0)
    kept = w > 2e-3
    kept[np.argmax(w)] = True
    return {"r_pa": [s["r_pa"] for s, yes in zip(settings, kept, strict=True) if yes], "w": w[kept].tolist()}


TERM = Term(
    word="hysteresis",
    scopes=("insole", "board", "triangle"),
    share="positive",
    columns=_columns,
    parameters=_parameters,
    known_parameters=_known_parameters,
    plausible=0.1,
    limit=4.0,
    known_most=MOST_SHARED,
    absorbs={**ABSORBED, "uneven_loops": UNEVEN},
    misfit=0.03,
)
