"""The memory of the material, estimated from the swings of a walk and undone.

An elastomer goes on reading a step after toe-off, and reads less than the load during it. In swing the load is zero, so
what is read then is an offset and the memory. The model is a standard linear solid (Zener), superposed after Boltzmann,
the law `viscoelasticity`, with one a and τ for the whole sole:

    q = (1 − a)·P + a·z,   τ·dz/dt = P − z

Its inverse is applied to f_z for every pair (a, τ) of a grid. The pair is chosen that leaves the least square of f_z in
the inner part of the swings beside an offset, which is linear between knots `KNOT_S` apart. So a slow drift is not
taken for a memory, and a memory that lasts much longer than a swing is taken for an offset. The memory is undone only
if it explains `LEAST_CHI2` variances of what remains. A swing in which the foot was touched does not pull: see
`ROUNDS`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Moments
from ...physics.relaxation import Relaxation

FRACTIONS = np.linspace(0.0, 0.3, 31)
TIME_CONSTANTS_S = np.geomspace(0.08, 1.0, 12)
KNOT_S = 15.0
LEAST_CHI2 = 9.0  # of two parameters: p = 0.01; leaving a memory in costs more than undoing one that is not there
FEWEST_SAMPLES = 100  # in swing
ROUNDS = 3  # after each, samples with residuals beyond FAR robust standard deviations are dropped
FAR = 4.0
_ROWS_AT_ONCE = 2048

Array = NDArray[np.float64]
Loads = TypeVar("Loads", NDArray[np.float32], NDArray[np.float64])


@dataclass(frozen=True, slots=True)
class MaterialMemory:
    """The share `fraction` of the answer comes late, with the time constant `tau_s`."""

    fraction: float
    tau_s: float

    def undo(self, t_s: Array, readings: Loads) -> Loads:
        """Return the loads (n, …) behind `readings` (n, …) at `t_s` (n,), in their type.

        The first reading is taken as settled. NaN counts as 0 for what follows, and stays NaN.
        """
        flat = readings.reshape(len(readings), -1)
        inverse, loads = _inverse(np.array([self.fraction]), np.array([self.tau_s])), np.empty_like(flat)
        dt_s = np.diff(t_s, prepend=t_s[:1])
        for first in range(0, len(flat), _ROWS_AT_ONCE):
            rows = slice(first, first + _ROWS_AT_ONCE)
            piece = flat[rows].astype(np.float64)
            loads[rows] = inverse(np.nan_to_num(piece), Moments(t_s[rows], dt_s[rows], None)) + 0.0 * piece
        return loads.reshape(readings.shape)


def estimate_memory(t_s: Array, f_z_n: Array, in_swing: NDArray[np.bool_]) -> MaterialMemory | None:
    """Return the memory that `f_z_n` (n,) shows in the samples `in_swing` (n,); None where it shows none."""
    in_swing = in_swing & np.isfinite(f_z_n)
    n = int(np.count_nonzero(in_swing))
    if n < FEWEST_SAMPLES:
        return None
    fractions, tau_s = (grid.ravel() for grid in np.meshgrid(FRACTIONS, TIME_CONSTANTS_S, indexing="ij"))
    readings = np.repeat(np.nan_to_num(f_z_n)[:, None], fractions.size, axis=1)
    moments = Moments(t_s, np.diff(t_s, prepend=t_s[:1]), None)
    loads = _inverse(fractions, tau_s)(readings, moments)[in_swing]
    hats, kept = _hats(t_s[in_swing]), np.ones(n, np.bool_)
    for _ in range(ROUNDS):
        offset, triangular = np.linalg.qr(hats[kept])
        on_offset = offset.T @ loads[kept]
        cost = (loads[kept] ** 2).sum(axis=0) - (on_offset**2).sum(axis=0)
        best = int(cost.argmin())
        slow = hats @ np.linalg.lstsq(triangular, on_offset[:, best], rcond=None)[0]
        residuals = loads[:, best] - slow
        explained, remaining, usual = cost[0] - cost[best], residuals[kept], np.median(np.abs(residuals[kept]))
        kept = np.abs(residuals) <= FAR * 1.4826 * usual
    variance = float(np.mean(remaining**2)) * _inflation(remaining)
    if fractions[best] == 0 or explained < LEAST_CHI2 * variance:
        return None
    return MaterialMemory(float(fractions[best]), float(tau_s[best]))


def _inverse(fractions: Array, tau_s: Array) -> Relaxation:
    return Relaxation(1.0 - fractions, fractions[None], tau_s[None], is_inverse=True)


def _hats(t_s: Array) -> Array:
    """Return (n, k) functions that are linear between k knots."""
    knots_s = np.linspace(t_s[0], t_s[-1], max(2, round(float(t_s[-1] - t_s[0]) / KNOT_S) + 1))
    return np.stack([np.interp(t_s, knots_s, row) for row in np.eye(len(knots_s))], axis=1)


def _inflation(residuals: Array) -> float:
    """Return (1 + ρ)/(1 − ρ): how many correlated samples say as much as one that is independent."""
    square = float((residuals**2).sum())
    correlation = float((residuals[1:] * residuals[:-1]).sum()) / square if square > 0 else 0.0
    correlation = min(max(correlation, 0.0), 0.95)
    return (1.0 + correlation) / (1.0 - correlation)
