"""The displacement of an insole against its map that explains most of a trial, when its load was simulated.

Columns of `map_transform` are straight lines about the present place. A displacement of a centimetre is no straight
line, and a search on such columns would describe what they leave by many terms; so a displacement that explains most by
itself is fitted before the search.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from ...physics.law import Array
from ..load_estimate import KnownLoad
from ..model.nuisance import USUAL, nuisance_of
from ..observations.load_field import Move
from ..observations.paired import PairedObservation

STEP = 0.5  # of central differences: mm, degrees, per cent
PASSES = 3  # of the fit; after each, triangles whose load is not known at their place are left out
ROUNDS = 30  # of least squares in a pass
LARGEST = 30.0  # mm, degrees or per cent


@dataclass(frozen=True, slots=True)
class Displacement:
    """A fitted displacement, and the share of the squared residual beyond the noise that it explains."""

    move: Move
    explained: float


def fit_displacement(seen: PairedObservation, weights: Array) -> Displacement:
    """Return the displacement of the insole by non-linear least squares with a trust region.

    `weights` (N, T): one over the standard deviation of a row; 0 if unknown. The share is that of triangles whose load
    is known after the displacement, with the nuisances of each triangle projected out.
    """
    nuisance = nuisance_of(KnownLoad(seen), weights, USUAL)

    def moved(parameters: Array) -> PairedObservation:
        return seen.replaced(_move(parameters), ())

    def residual(parameters: Array) -> Array:
        reference_pa = moved(parameters).reference.at(seen.reference_s)
        y = np.ascontiguousarray(((reference_pa - seen.wrench) * weights).T)
        return np.asarray(nuisance.residual_of(y)[is_known].ravel())

    def slopes(parameters: Array) -> Array:
        steps = STEP * np.eye(len(parameters))
        return np.stack([(residual(parameters + step) - residual(parameters - step)) / (2 * STEP) for step in steps], 1)

    at, is_known = np.zeros(4), np.ones(len(seen.layout), bool)
    for _ in range(PASSES):
        fitted = least_squares(residual, at, slopes, bounds=(-LARGEST, LARGEST), max_nfev=ROUNDS)
        at, was_known = fitted.x, is_known
        field = moved(at).field
        assert field is not None
        is_known = np.asarray(~field.spoiled.all(axis=0))
        if np.array_equal(is_known, was_known) or not is_known.any():
            break
    before, after = (float(np.sum(residual(parameters) ** 2)) for parameters in (np.zeros(4), at))
    noise = float(np.count_nonzero(weights[:, is_known]))
    explained = (before - after) / (before - noise) if before > noise else 0.0
    return Displacement(_move(at), explained)


def _move(parameters: Array) -> Move:
    """Return the displacement of four parameters, mm, mm, degrees and per cent."""
    x_mm, y_mm, rotation_deg, larger = parameters.tolist()
    return Move(x_mm, y_mm, rotation_deg, 0.01 * larger)
