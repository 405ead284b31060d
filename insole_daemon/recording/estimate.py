"""Compute pressure and wrench from recorded counts with the daemon's model, many cycles at once."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..config import Board, Contact
from ..mechanics.wrench import WrenchEstimator, WrenchSeries
from ..physics.calibration import Calibration
from ..physics.dynamic import DynamicModel
from ..physics.static_curve import StaticCurve
from ..skin.layout import Layout

ModelName = Literal["static", "dynamic"]

_BATCH_CYCLES = 2048  # cycles per batch, which bounds the memory for float64 arrays


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Pressure and wrench of n cycles."""

    t_ns: NDArray[np.int64]  # (n,) time of the load: that of the cycle minus the delay common to all boards
    pressure_pa: NDArray[np.float32]  # (n, n_triangles, 12) NaN: taxel not in the calibration
    valid: NDArray[np.bool_]  # (n, n_triangles, 12) usable as pressure
    beyond: NDArray[np.bool_]  # (n, n_triangles, 12) outside the range in which the effects were identified
    wrench: WrenchSeries


def estimate(
    layout: Layout,
    calibration: Calibration,
    boards: Sequence[Board],
    t_ns: NDArray[np.int64],
    counts: NDArray[np.uint8],
    valid: NDArray[np.bool_],
    *,
    zeroed: bool,
    model: ModelName = "dynamic",
) -> Estimate:
    """Estimate consecutive cycles with the daemon's defaults.

    `t_ns` (n,), `counts` and `valid` (n, n_triangles, 12). `zeroed` states that the calibration has the baselines of a
    zero. Without effects in the calibration, both models give the same result.
    """
    contact = Contact()
    curve = StaticCurve(calibration, contact.activation_threshold_count)
    dynamic = None
    if calibration.effects and model == "dynamic" and len(t_ns):
        dynamic = DynamicModel(layout, calibration, boards, int(t_ns[0]), zeroed=zeroed)
        dynamic.mask(contact.activation_threshold_count)
        layout = dataclasses.replace(layout, xy_m=dynamic.xy_m)
        late_ns = int(dynamic.late_ns.min())
    t_s = (np.maximum.accumulate(t_ns) - t_ns[:1]).astype(np.float64) * 1e-9
    estimator = WrenchEstimator(layout, contact.min_force_n, contact.min_pressure_pa)
    pressure_pa, beyond = np.empty(counts.shape, np.float32), np.zeros(counts.shape, np.bool_)
    is_valid, series = valid & curve.usable, []
    for first in range(0, len(counts), _BATCH_CYCLES):
        rows = slice(first, first + _BATCH_CYCLES)
        exact_pa, variance_pa2 = curve.pressure_pa(counts[rows]), curve.variance_pa2(counts[rows])
        if dynamic is not None:
            inverted = dynamic(exact_pa, counts[rows], is_valid[rows], t_s[rows])
            exact_pa, is_valid[rows], beyond[rows] = inverted.pressure_pa, inverted.valid, inverted.beyond
            variance_pa2 = None if variance_pa2 is None else dynamic.at_places(variance_pa2)
        pressure_pa[rows] = exact_pa
        series.append(estimator.series(exact_pa, is_valid[rows], variance_pa2))
    stamped_ns = t_ns if dynamic is None else t_ns - late_ns
    return Estimate(stamped_ns, pressure_pa, is_valid, beyond, WrenchSeries.concatenate(series))
