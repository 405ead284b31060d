"""Rows for another search, corrected by the set that the last one found: static curves and variances.

The regression is linear about the static curves. If an effect acted while they were fitted, their slopes are wrong
where it acts, and with them its size, so it is repeated about corrected curves. While a snap switches, a reading tells
nothing: the taxels of a triangle do so each at its own load.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from ..model.blocks import BlockDesign
from ..model.curves import CurveShares
from ..model.refine import Refined
from ..observations.chamber import ChamberObservation

EDGE_S = 0.1  # before and after a switch


def with_corrected_curves(seen: ChamberObservation, corrections: CurveShares) -> ChamberObservation:
    """Return the same rows with corrected curves."""
    given, top_count = seen.calibration.coefficients_pa, seen.top_count
    curves = {
        (row, taxel): corrections.corrected(given[row, taxel], float(top_count[row, taxel]), row, taxel)
        for row, taxel in np.argwhere(seen.usable).tolist()
    }
    coefficients_pa = np.zeros((*seen.usable.shape, max(map(len, curves.values()))))
    for at, curve in curves.items():
        coefficients_pa[at][: len(curve)] = curve
    return seen.with_curves(coefficients_pa)


def with_uncertain_switching(seen: ChamberObservation, refined: Refined[BlockDesign]) -> ChamberObservation:
    """Return the same rows with a larger variance while the snaps of a set switch; `seen` itself if nothing changes.

    Taxels of a triangle snap each at its own load, and rows between readings are before or after an edge.
    """
    design = refined.design
    width = 2 * round(EDGE_S / design.seen.step_s) + 1
    square = np.zeros(design.weights.shape)
    for candidate, shares in zip(design.candidates, refined.shares, strict=True):
        if candidate.word == "snap":
            column = candidate.term.column_of(design.load, candidate.settings[0]).by_triangle
            assert column is not None
            change_pa = float(shares[0]) * column[..., 0, 0] * design.mask[candidate.columns[0]]
            range_pa = maximum_filter1d(change_pa, width, axis=0) - minimum_filter1d(change_pa, width, axis=0)
            square += (0.5 * range_pa) ** 2
    if not square.any() and seen.switching_pa is None:
        return seen
    return seen.timed(switching_pa=np.sqrt(square) if square.any() else None)
