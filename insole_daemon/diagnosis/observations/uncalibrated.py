"""Estimate the load of triangles that the calibration does not list, on a walk.

Their load is part of the reference's wrench. Their readings are converted by the mean curve of the calibrated taxels,
with the baseline of the swing phases; a gain of each is fitted to the reference. In the regression such a triangle has
the same free gain as one with dead taxels.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from ...physics.calibration import Calibration
from ...physics.law import Array
from ...skin.geometry import PRESSURE_TAXELS
from .grid_readings import LEAST_ROWS, noise_of_triangle
from .wrench import WrenchObservation

UNLOADED = 0.02  # share of the reference's range of f_z
NEAR_S = 0.15  # before and after, in which the foot is in the air, too: readings may be late
LEAST_RESPONSE_COUNT = 2.0  # from the swing phase to the highest load, of a taxel that works
GAIN_STD = 0.5  # prior of the gain of a triangle on the mean curve


def with_uncalibrated(seen: WrenchObservation) -> WrenchObservation:
    """Return `seen` with the loads of its uncalibrated triangles; unchanged if the foot is never in the air."""
    is_listed = np.asarray(seen.calibration.usable.any(axis=1))
    force = seen.reference.at(seen.reference_s)[:, 0]
    known = seen.reference.is_known(seen.reference_s)
    if is_listed.all() or not known.any():
        return seen
    low, high = float(force[known].min()), float(force[known].max())
    in_air = known & (force < low + UNLOADED * (high - low))
    in_air = minimum_filter1d(in_air.astype(np.uint8), 2 * round(NEAR_S / seen.step_s) + 1) > 0
    if in_air.sum() < LEAST_ROWS:
        return seen
    activation, usable, noise = seen.activation_count.copy(), seen.usable.copy(), seen.noise_count.copy()
    baseline = seen.calibration.baseline_count.copy()
    for row in np.flatnonzero(~is_listed).tolist():
        counts = seen.readings[row].at(seen.t_s)
        baseline[row] = counts[in_air].mean(axis=0)
        activation_of_triangle = baseline[row] - counts
        responds = np.quantile(activation_of_triangle, 0.99, axis=0) > LEAST_RESPONSE_COUNT
        usable[row] = PRESSURE_TAXELS & np.isfinite(counts).all(axis=0) & responds
        activation[:, row] = np.where(usable[row], activation_of_triangle, 0.0)
        noise[row] = np.where(usable[row], noise_of_triangle(seen.readings[row]), 0.0)
    is_estimated = np.asarray(~is_listed & usable.any(axis=1))
    if not is_estimated.any():
        return seen
    coefficients_pa = seen.calibration.coefficients_pa
    mean_curve = np.mean(coefficients_pa[seen.calibration.usable], axis=0)

    def with_gains(gains: Array) -> Calibration:  # its `usable` still excludes the estimated triangles
        curves = gains[:, None, None] * mean_curve
        return replace(
            seen.calibration, baseline_count=baseline,
            coefficients_pa=np.where(is_estimated[:, None, None], curves, coefficients_pa),
        )  # fmt: skip

    estimated = replace(
        seen, calibration=with_gains(np.ones(len(is_listed))), activation_count=activation, usable=usable,
        noise_count=noise, is_estimated=is_estimated,
    )  # fmt: skip
    return replace(estimated, calibration=with_gains(_gains(estimated, is_estimated)))


def _gains(seen: WrenchObservation, is_estimated: NDArray[np.bool_]) -> Array:
    """Return the factors (T,) on the mean curve of estimated triangles that fit the reference's wrench; 1 for others.

    Least squares with the prior 1 ± GAIN_STD.
    """
    weights = 1.0 / np.sqrt(seen.weight_variance)  # 0 where the reference is not known
    rows = np.flatnonzero(is_estimated)
    columns = (seen.by_triangle[:, rows] * weights[:, None]).transpose(0, 2, 1).reshape(-1, len(rows))
    residual = ((seen.reference.smooth_at(seen.reference_s) - seen.wrench) * weights).ravel()
    gain_changes = np.linalg.solve(columns.T @ columns + np.eye(len(rows)) / GAIN_STD**2, columns.T @ residual)
    gains = np.ones(len(is_estimated))
    gains[rows] += gain_changes
    return gains
