"""Bring all triangles of a recorded foot to common times, and compute the wrench at those times.

Boards send when they like: the pressures of one cycle were read up to a period apart. And a board whose converters are
slower than its messages sends every conversion more than once: a conversion that is new was finished between the
reading before and this one, on average in the middle. Between two conversions the pressure of a triangle is taken as
linear. Steps need this; messages and tables keep what was received.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..config import Contact
from ..errors import InsoleError
from ..mechanics.wrench import WrenchEstimator, WrenchSeries
from ..physics.chain import Chain
from .loading import FootRecording, as_configured
from .read_times import arrived

LEAST_REPEATED_FRACTION = 0.05  # of a triangle's readings: from here on its converter is the slower one
LONGEST_GAP_NS = 100_000_000  # between conversions; in a longer gap the pressure stays where it was
HOLD = "sample_and_hold"


@dataclass(frozen=True, slots=True, eq=False)
class AlignedFoot:
    """The n cycles that brought a new reading, at common times."""

    cycle: NDArray[np.intp]  # (n,) index of the cycle in the recording
    t_ns: NDArray[np.int64]  # (n,) time of the pressure, increasing
    pressure_pa: NDArray[np.float32]  # (n, n_triangles, 12)
    valid: NDArray[np.bool_]  # (n, n_triangles, 12)
    wrench: WrenchSeries  # standard deviations are taken from the cycles


def align(foot: FootRecording) -> AlignedFoot:
    """Return the pressures of `foot` at common moments.

    InsoleError: the foot has no calibration.
    """
    if foot.calibration is None or foot.pressure_pa is None or foot.wrench is None:
        raise InsoleError(f"the {foot.foot} foot has no calibration: expected one, to make pressure of its counts")
    newest_ns = np.maximum.accumulate(foot.t_ns)
    cycle = np.flatnonzero(~foot.repeated & (np.diff(newest_ns, prepend=-1) > 0))
    t_ns = foot.t_ns[cycle]
    pressure_pa, valid = foot.pressure_pa[cycle], foot.valid[cycle]
    if len(cycle):
        age_ns = conversion_age_ns(foot)
        common_ns = round(float(np.median(age_ns[cycle][foot.is_new[cycle]]))) if foot.is_new[cycle].any() else 0
        t_ns = t_ns - common_ns
        _interpolate(foot, age_ns, t_ns, pressure_pa, valid)
    contact = Contact()
    places = [effect for effect in foot.calibration.effects if effect.law.domain == "place"]
    layout = replace(foot.layout, xy_m=Chain(places, foot.layout).xy_m)
    estimator = WrenchEstimator(layout, contact.min_force_n, contact.min_pressure_pa)
    wrench = estimator.series(pressure_pa.astype(np.float64), valid, None)
    std = {name: getattr(foot.wrench, name)[cycle] for name in ("f_z_std_n", "m_x_std_nm", "m_y_std_nm")}
    return AlignedFoot(cycle, t_ns, pressure_pa, valid, replace(wrench, **std))


def conversion_age_ns(foot: FootRecording) -> NDArray[np.int64]:
    """Return (n, n_triangles) by how much the load behind each reading is older than its cycle's `t_ns`.

    That is the age of the reading, the delays that the calibration states, and half an interval between readings where
    the converter is slower than the messages.
    """
    assert foot.calibration is not None
    boards = [as_configured(board) for board in foot.boards]
    hold = [effect for effect in foot.calibration.effects if effect.law.word == HOLD]
    others = [effect for effect in foot.calibration.effects if effect.law.word != HOLD]
    delay_ns, hold_ns = (
        np.rint(1e9 * Chain(effects, foot.layout, foot.calibration, boards).late_s.max(axis=1)).astype(np.int64)
        for effects in (others, hold)
    )
    age_ns: NDArray[np.int64] = foot.behind_ns + delay_ns
    came = arrived(foot.read_ns)
    for triangle in range(len(delay_ns)):
        rows = np.flatnonzero(came[:, triangle])
        is_repeated = ~foot.is_new[rows, triangle]
        if len(rows) < 2 or is_repeated.mean() < LEAST_REPEATED_FRACTION:
            age_ns[:, triangle] += hold_ns[triangle]
            continue
        interval_ns = np.diff(foot.read_ns[rows, triangle], prepend=foot.read_ns[rows[0], triangle])
        age_ns[rows, triangle] += interval_ns // 2
    return age_ns


def _interpolate(
    foot: FootRecording,
    age_ns: NDArray[np.int64],
    t_ns: NDArray[np.int64],
    pressure_pa: NDArray[np.float32],
    valid: NDArray[np.bool_],
) -> None:
    """Write what was on the insole at `t_ns` (n,) into `pressure_pa` and `valid` (n, n_triangles, 12)."""
    assert foot.pressure_pa is not None
    came, taken_ns = arrived(foot.read_ns), foot.t_ns[:, None] - age_ns
    for triangle in range(pressure_pa.shape[1]):
        rows = np.flatnonzero(came[:, triangle] & foot.is_new[:, triangle])
        rows = rows[np.diff(np.maximum.accumulate(taken_ns[rows, triangle]), prepend=np.iinfo(np.int64).min // 2) > 0]
        if len(rows) < 2:
            continue
        at_ns = taken_ns[rows, triangle]
        after = np.clip(np.searchsorted(at_ns, t_ns), 1, len(rows) - 1)
        gap_ns = at_ns[after] - at_ns[after - 1]
        part = np.clip((t_ns - at_ns[after - 1]) / gap_ns, 0.0, 1.0)
        part[(gap_ns > LONGEST_GAP_NS) & (part < 1.0)] = 0.0
        part = part.astype(np.float32)[:, None]
        before, behind = rows[after - 1], rows[after]
        before_pa, behind_pa = foot.pressure_pa[before, triangle], foot.pressure_pa[behind, triangle]
        pressure_pa[:, triangle] = np.where(
            part == 0, before_pa, np.where(part == 1, behind_pa, before_pa + part * (behind_pa - before_pa))
        )
        valid[:, triangle] &= (foot.valid[before, triangle] | (part == 1)) & (
            foot.valid[behind, triangle] | (part == 0)
        )
