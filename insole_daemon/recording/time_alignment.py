"""Bring all triangles of a recorded foot to common times, and compute the wrench at those times.

Boards send asynchronously, so the pressures of one cycle were read up to a period apart. A triangle's pressure is
interpolated linearly between two cycles. Only the detection of steps uses this; messages and tables keep the received
values.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..config import Contact
from ..errors import InsoleError
from ..mechanics.wrench import WrenchEstimator, WrenchSeries
from .loading import FootRecording

_LATEST_PERCENT = 95.0  # percentile of the lags by which the common time precedes the newest half of a cycle
_LONGEST_LAG_NS = 40_000_000  # older readings are stale and are not interpolated


@dataclass(frozen=True, slots=True, eq=False)
class AlignedFoot:
    """The n cycles that brought a new reading, at common times."""

    cycle: NDArray[np.intp]  # (n,) index of the cycle in the recording
    t_ns: NDArray[np.int64]  # (n,) time of the pressure, increasing
    pressure_pa: NDArray[np.float32]  # (n, n_triangles, 12)
    valid: NDArray[np.bool_]  # (n, n_triangles, 12)
    wrench: WrenchSeries  # standard deviations are taken from the cycles


def align(foot: FootRecording) -> AlignedFoot:
    """Return the pressures of `foot` at common times; InsoleError if it has no calibration."""
    if foot.pressure_pa is None or foot.wrench is None:
        raise InsoleError(f"the {foot.foot} foot has no calibration: expected one, to convert its counts to pressure")
    newest_ns = np.maximum.accumulate(foot.t_ns)
    cycle = np.flatnonzero(~foot.repeated & (np.diff(newest_ns, prepend=-1) > 0))
    t_ns, lag_ns = foot.t_ns[cycle], foot.behind_ns[cycle]
    lag_ns[lag_ns > _LONGEST_LAG_NS] = 0
    common_ns = round(float(np.percentile(lag_ns, _LATEST_PERCENT))) if lag_ns.size else 0
    read_ns = t_ns[:, None] - lag_ns
    interval_ns = np.diff(read_ns, axis=0, prepend=read_ns[:1])
    shift_ns = np.clip(common_ns - lag_ns, 0, np.maximum(interval_ns, 0))
    fraction = np.where(interval_ns > 0, shift_ns / np.maximum(interval_ns, 1), 0.0)[..., None].astype(np.float32)
    current, current_valid = foot.pressure_pa[cycle], foot.valid[cycle]
    previous, previous_valid = np.roll(current, 1, axis=0), np.roll(current_valid, 1, axis=0)
    pressure_pa = np.where(fraction > 0, current + fraction * (previous - current), current)
    valid = current_valid & (previous_valid | (fraction == 0))
    contact = Contact()
    estimator = WrenchEstimator(foot.layout, contact.min_force_n, contact.min_pressure_pa)
    wrench = estimator.series(pressure_pa.astype(np.float64), valid, None)
    std = {name: getattr(foot.wrench, name)[cycle] for name in ("f_z_std_n", "m_x_std_nm", "m_y_std_nm")}
    return AlignedFoot(cycle, t_ns - common_ns, pressure_pa, valid, replace(wrench, **std))
