"""Nuisance columns of a recording in which the load is known only as a wrench: what every model contains.

They are the timing and the zero of the reference, errors of the calibration, and loads that no taxel reads, each with a
tight prior.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ...skin.geometry import PRESSURE_TAXELS
from ..load_estimate import LoadEstimate
from ..observations.pad_temperature import rounding_of_compensation

GAIN_STD = 0.005  # of a triangle's calibration
BASELINE_STD_COUNT = 0.02  # of a board, common to its taxels
COMPENSATION_STD_COUNT = 0.25  # of all boards, at the largest rounding error of the firmware's compensation
ZERO_STD = (0.5, 0.02, 0.05)  # of the reference, N and N·m
OWN_OFFSET_STD_S, OWN_RATE_STD = 1.0, 0.1  # of a reference's own clock
INTERPOLATION_STD = 0.5  # of a board's share of the load, times the interpolation error of the reference
CURVE_STD_COUNT, CURVE_KNOTS = 0.05, 7  # misfit of the static curves, and number of knots
CURVE_STD_AT_REST_COUNT = 0.015  # of the first knot: a baseline is measured, not fitted
UNKNOWN_TAXEL_STD = 0.05  # of a triangle's share of the load, for each of its ten taxels that does not work
SUBSTITUTED_STD = 0.5  # of the share of the load of a triangle with substituted taxels
NEIGHBOURS = 6  # nearest triangles whose load a triangle without working taxels may have


@dataclass(frozen=True, eq=False)
class NuisanceColumns:
    """The b nuisance columns of N rows with three channels, with their prior standard deviations."""

    names: tuple[str, ...]
    matrix: Array  # (3N, b) weighted
    prior_std: Array  # (b,)

    @cached_property
    def range(self) -> Array:
        """Return an orthonormal basis (3N + b, b) of the columns with the rows of their priors appended."""
        return np.asarray(np.linalg.qr(np.concatenate([self.matrix, np.diag(1.0 / self.prior_std)]))[0])


def apply_weights(columns: Array, weights: Array) -> Array:
    """Return `columns` (N, 3, k) with each row times its weight, as (3N, k)."""
    return np.asarray((columns * weights[..., None]).reshape(-1, columns.shape[-1]))


def project(base: NuisanceColumns, columns: Array) -> Array:
    """Return `columns` (3N, k) without their part in the nuisance columns, shrunk by the priors: (3N + b, k).

    With R the nuisance columns augmented by the rows diag(1/σ) of their priors, the residual of [columns; 0] on R has
    the inner products of a ridge regression; its last b rows belong to the priors and are kept.
    """
    basis, n_rows = base.range, len(columns)
    padded = np.concatenate([columns, np.zeros((len(base.names), columns.shape[1]))])
    return np.asarray(padded - basis @ (basis[:n_rows].T @ columns))


def nuisance_columns(load: LoadEstimate, weights: Array, substituted: NDArray[np.bool_]) -> NuisanceColumns:
    """Return the nuisance columns: clock, zero of the reference, gains of triangles, baselines of boards, curves."""
    seen = load.observation
    names: list[str] = []
    columns: list[Array] = []
    stds: list[float] = []

    def add(name: str, column: Array, std: float) -> None:
        names.append(name)
        columns.append(column)
        stds.append(std)

    slope = seen.reference.slope(seen.reference_s)
    if seen.offset_is_free:
        # The residual is reference − insole, so an offset of the clock changes it by the reference's slope.
        add("offset_s", -slope, OWN_OFFSET_STD_S)
        if seen.rate_is_free:
            add("rate", -slope * (seen.t_s - seen.t_s.mean())[:, None], OWN_RATE_STD)
    for board, (error, _) in seen.interpolation_error.items():
        add(f"unresolved_{board}", error, INTERPOLATION_STD)
    for channel, std in enumerate(ZERO_STD):
        add(f"zero_{channel}", np.broadcast_to(np.eye(3)[channel], slope.shape), std)
    gain = load.wrench_of(-load.slope_pa * load.activation_count)
    offset = load.wrench_of(load.slope_pa)
    n_unknown = np.sum(seen.calibration.usable & PRESSURE_TAXELS & ~seen.usable, axis=1)
    for row, (board, triangle) in enumerate(seen.layout.identities.tolist()):
        std = SUBSTITUTED_STD if substituted[row] else np.hypot(GAIN_STD, UNKNOWN_TAXEL_STD * n_unknown[row])
        add(f"gain_{board}_{triangle}", gain[:, row], std)
    rate = np.gradient(load.by_triangle, seen.step_s, axis=0)
    for row, readings in enumerate(seen.readings):
        if seen.is_wholly_substituted is not None and seen.is_wholly_substituted[row]:
            bears = ~seen.is_wholly_substituted & seen.usable.any(axis=1)
            for donor in [near for near in seen.nearest(row).tolist() if bears[near]][:NEIGHBOURS]:
                mean_pa = np.mean(load.read_pa[:, donor, seen.usable[donor]], axis=1)
                add(f"like_{row}_{donor}", mean_pa[:, None] * seen.arms[row].sum(axis=0), SUBSTITUTED_STD)
        if readings.latest_s:
            add(f"time_{row}", rate[:, row], readings.latest_s / np.sqrt(3.0))
    # The misfit of the calibration's polynomials is taken as common to all taxels.
    highest = float(np.quantile(seen.activation_count[:, seen.usable], 0.999))
    knots = np.linspace(0.0, max(highest, 1.0), CURVE_KNOTS)
    for k, hat in enumerate(np.eye(CURVE_KNOTS)):
        shape = np.interp(load.activation_count, knots, hat)
        std = CURVE_STD_COUNT if k else CURVE_STD_AT_REST_COUNT
        add(f"curve_{k}", load.wrench_of(load.slope_pa * shape).sum(axis=1), std)
    boards = seen.layout.identities[:, 0]
    for board in np.unique(boards):
        add(f"baseline_{board}", offset[:, boards == board].sum(axis=1), BASELINE_STD_COUNT)
        waited_s = max(seen.readings[row].waited_s for row in np.flatnonzero(boards == board).tolist())
        if waited_s:
            add(f"time_of_board_{board}", rate[:, boards == board].sum(axis=1), waited_s / np.sqrt(3.0))
    rounding = rounding_of_compensation(seen)
    if rounding.any():
        add("compensation", offset.sum(axis=1) * rounding[:, None], COMPENSATION_STD_COUNT)
    matrix = apply_weights(np.stack(columns, axis=-1), weights)
    return NuisanceColumns(tuple(names), matrix, np.array(stds))
