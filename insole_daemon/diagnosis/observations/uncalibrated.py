"""Triangles that a calibration does not list, below a foot: their load is in the reference's wrench all the same.

Their readings tell it by the mean curve of the calibrated taxels, from where they rest while the foot is in the air.
How much such a triangle bears is fitted to the reference; it stays as free as that of a triangle with dead taxels.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from ...physics.calibration import Calibration
from ...physics.law import Array
from ...skin.geometry import PRESSURE_TAXELS
from .wrench import LEAST_ROWS, WrenchObservation, noise_of_triangle

UNLOADED = 0.02  # of the reference's range of f_z
NEAR_S = 0.15  # before and after which the foot is in the air, too: readings may be late
LEAST_RESPONSE_COUNT = 2.0  # between the air and the most load, of a taxel that works
GAIN_STD = 0.5  # of the answer of a triangle to the mean curve


def with_uncalibrated(seen: WrenchObservation) -> WrenchObservation:
    """`seen` with what its uncalibrated triangles read; without a moment in the air as it is."""
    listed = np.asarray(seen.calibration.usable.any(axis=1))
    force = seen.reference.at(seen.reference_s)[:, 0]
    known = seen.reference.is_known(seen.reference_s)
    if listed.all() or not known.any():
        return seen
    low, high = float(force[known].min()), float(force[known].max())
    in_air = known & (force < low + UNLOADED * (high - low))
    in_air = minimum_filter1d(in_air.astype(np.uint8), 2 * round(NEAR_S / seen.step_s) + 1) > 0
    if in_air.sum() < LEAST_ROWS:
        return seen
    activation, usable, noise = seen.activation_count.copy(), seen.usable.copy(), seen.noise_count.copy()
    baseline = seen.calibration.baseline_count.copy()
    for row in np.flatnonzero(~listed).tolist():
        counts = seen.readings[row].at(seen.t_s)
        baseline[row] = counts[in_air].mean(axis=0)
        own = baseline[row] - counts
        responds = np.quantile(own, 0.99, axis=0) > LEAST_RESPONSE_COUNT
        usable[row] = PRESSURE_TAXELS & np.isfinite(counts).all(axis=0) & responds
        activation[:, row] = np.where(usable[row], own, 0.0)
        noise[row] = np.where(usable[row], noise_of_triangle(seen.readings[row]), 0.0)
    is_estimated = np.asarray(~listed & usable.any(axis=1))
    if not is_estimated.any():
        return seen
    listed_pa = seen.calibration.coefficients_pa
    mean_curve = np.mean(listed_pa[seen.calibration.usable], axis=0)

    def with_gains(gains: Array) -> Calibration:  # which still does not list the estimated triangles
        curves = gains[:, None, None] * mean_curve
        return replace(
            seen.calibration, baseline_count=baseline,
            coefficients_pa=np.where(is_estimated[:, None, None], curves, listed_pa),
        )  # fmt: skip

    found = replace(
        seen, calibration=with_gains(np.ones(len(listed))), activation_count=activation, usable=usable,
        noise_count=noise, is_estimated=is_estimated,
    )  # fmt: skip
    return replace(found, calibration=with_gains(_gains(found, is_estimated)))


def _gains(seen: WrenchObservation, is_estimated: NDArray[np.bool_]) -> Array:
    """(T,) by which the mean curve of estimated triangles has to be multiplied for the reference's wrench; 1 of others.

    Least squares with a prior of 1 ± GAIN_STD.
    """
    weights = 1.0 / np.sqrt(seen.weight_variance)  # 0 where the reference is not known
    rows = np.flatnonzero(is_estimated)
    columns = (seen.by_triangle[:, rows] * weights[:, None]).transpose(0, 2, 1).reshape(-1, len(rows))
    left = ((seen.reference.smooth_at(seen.reference_s) - seen.wrench) * weights).ravel()
    more = np.linalg.solve(columns.T @ columns + np.eye(len(rows)) / GAIN_STD**2, columns.T @ left)
    gains = np.ones(len(is_estimated))
    gains[rows] += more
    return gains
