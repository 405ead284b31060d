"""Find the board at which an unknown error of the wrench acts.

The wrench of an error at one board points along that of the board's load: its moments are the force times the centre of
pressure of the board. So the part of the residual along this direction is near 1 for the right board alone.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from ...physics.effect import Where
from ...physics.law import Array
from ..observations.wrench import WrenchObservation

SLOW_S = 0.2  # window of a moving average, which reduces noise
LOADED = 0.1  # of a board's largest force: below, the centre of pressure is that of its taxels
LEAST_ALONG = 0.95  # of the residual's square along the direction of its board
CLEARER = 4.0  # times as much of the square is across the direction of any other board


def residual_board(seen: WrenchObservation, residual: Array, weights: Array) -> Where:
    """Return the board that causes the `residual` (N, 3) of force and moments, N and N·m.

    The whole insole if the residual fits no board, or fits two about equally.

    `weights` (N, 3): one over the standard deviation of a row; 0 if unknown.
    """
    known = weights.all(axis=1)
    weighted = uniform_filter1d(residual * weights, max(round(SLOW_S / seen.step_s), 1), axis=0)[known]
    square, boards = float(np.sum(weighted**2)), seen.layout.identities[:, 0]
    across = sorted(
        (1.0 - float(np.sum(np.sum(weighted * direction[known], axis=1) ** 2)) / square, board)
        for board in np.unique(boards).tolist()
        for direction in (_unit(_direction(seen, boards == board) * weights),)
    )
    if len(across) < 2 or across[0][0] > 1.0 - LEAST_ALONG or across[1][0] < CLEARER * across[0][0]:
        return Where()
    return Where("board", ((across[0][1],),))


def _direction(seen: WrenchObservation, at: Array) -> Array:
    """Return the wrench (N, 3) of a force of 1 N at the centre of pressure of the triangles `at` (T,)."""
    wrench = seen.by_triangle[:, at].sum(axis=1)
    force = wrench[:, :1]
    x, y = seen.layout.xy_m[at].mean(axis=(0, 1))
    is_loaded = force > LOADED * np.quantile(force, 0.98)
    return np.where(is_loaded, wrench / np.where(is_loaded, force, 1.0), np.array([1.0, y, -x]))


def _unit(vectors: Array) -> Array:
    """Return `vectors` (N, 3) with length 1, or 0."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))
