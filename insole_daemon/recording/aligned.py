"""A recorded foot with every triangle brought to the same moments, and its wrench at them.

Boards send when they like: the pressures of one cycle were read up to a period apart. Between two cycles the pressure
of a triangle is taken as linear. Steps need this; messages and tables keep what was received.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..config import Contact
from ..errors import InsoleError
from ..mechanics.wrench import WrenchEstimator, WrenchSeries
from .loading import FootRecording

_LATEST_PERCENT = 95.0  # of the lags: the moments lie this much before the newest half of a cycle
_LONGEST_LAG_NS = 40_000_000  # what is older is stale, and stays where it is


@dataclass(frozen=True, slots=True, eq=False)
class AlignedFoot:
    """n cycles that brought something new."""

    cycle: NDArray[np.intp]  # (n,) number of the cycle in the recording
    t_ns: NDArray[np.int64]  # (n,) when this pressure was on the insole, increasing
    pressure_pa: NDArray[np.float32]  # (n, n_triangles, 12)
    valid: NDArray[np.bool_]  # (n, n_triangles, 12)
    wrench: WrenchSeries  # standard deviations are those of the cycles


def align(foot: FootRecording) -> AlignedFoot:
    """The pressures of `foot` at common moments; InsoleError where it has no calibration."""
    if foot.pressure_pa is None or foot.wrench is None:
        raise InsoleError(f"the {foot.foot} foot has no calibration: expected one, to make pressure of its counts")
    newest_ns = np.maximum.accumulate(foot.t_ns)
    cycle = np.flatnonzero(~foot.repeated & (np.diff(newest_ns, prepend=-1) > 0))
    t_ns, lag_ns = foot.t_ns[cycle], foot.behind_ns[cycle]
    lag_ns[lag_ns > _LONGEST_LAG_NS] = 0
    common_ns = round(float(np.percentile(lag_ns, _LATEST_PERCENT))) if lag_ns.size else 0
    read_ns = t_ns[:, None] - lag_ns
    interval_ns = np.diff(read_ns, axis=0, prepend=read_ns[:1])
    early_ns = np.clip(common_ns - lag_ns, 0, np.maximum(interval_ns, 0))
    part = np.where(interval_ns > 0, early_ns / np.maximum(interval_ns, 1), 0.0)[..., None].astype(np.float32)
    now, valid_now = foot.pressure_pa[cycle], foot.valid[cycle]
    before, valid_before = np.roll(now, 1, axis=0), np.roll(valid_now, 1, axis=0)
    pressure_pa = np.where(part > 0, now + part * (before - now), now)
    valid = valid_now & (valid_before | (part == 0))
    contact = Contact()
    estimator = WrenchEstimator(foot.layout, contact.min_force_n, contact.min_pressure_pa)
    wrench = estimator.series(pressure_pa.astype(np.float64), valid, None)
    std = {name: getattr(foot.wrench, name)[cycle] for name in ("f_z_std_n", "m_x_std_nm", "m_y_std_nm")}
    return AlignedFoot(cycle, t_ns - common_ns, pressure_pa, valid, replace(wrench, **std))
