"""A recording with a force shoe into what is looked at: pressures of taxels and the wrench of the shoe, in time.

Counts are brought to the moments of a regular grid by a cubic through the moments at which each triangle was really
read, before they are turned into pressure: on the edge of a heel strike two milliseconds are ten newtons, and a
straight line between two cycles misses its bend.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ...calibration import clock as clocks
from ...errors import CalibrationError, DiagnosisError
from ...physics.calibration import Calibration
from ...physics.law import Array
from ...recording.document import Clock
from ...recording.loading import FootRecording, Recording
from ...skin.geometry import N_TAXELS
from ...skin.layout import Layout
from ..audit import Audit
from ..floor import noise_of_blocks, noise_of_readings

CHANNELS = ("fz_n", "mx_nm", "my_nm")
FINE_S = 0.005  # of the reference's grid
LEAST_ROWS = 100
LEAST_FORCE_N = 50.0
LEAST_AGREES = 0.7
MOST_GAP_S = 0.1  # of the reference, and
MOST_PERIODS = 1.6  # of the cycles: what lies in a longer one is not known
_MOST_OFFSET_S = 20.0


@dataclass(frozen=True, eq=False)
class Shoe:
    """The reference wrench, on a regular grid of its own clock."""

    epoch_s: float  # what the clock said at the first row, which times count from here
    wrench: Array  # (M, 3) f_z, m_x, m_y, every FINE_S
    told: NDArray[np.bool_]  # (M,) not in a gap
    noise: Array  # (3,) standard deviation of the white noise of its rows
    period_s: float  # of its rows
    clock: Clock

    @cached_property
    def t_s(self) -> Array:
        """(M,) times of the rows."""
        return np.arange(len(self.wrench), dtype=np.float64) * FINE_S


@dataclass(frozen=True, eq=False)
class Walk:
    """One insole in one recording: N moments of its m usable taxels."""

    name: str
    folder: Path
    layout: Layout
    slots: NDArray[np.intp]  # (m,) 12 · row of the triangle + taxel
    t_s: Array  # (N,) since the recording's first frame, regular
    period_s: float  # of the cycles
    activation_count: Array  # (N, m) baseline − count
    calibration: Calibration
    noise_count: Array  # (m,) standard deviation of one reading
    told: NDArray[np.bool_]  # (N,) moments at which every taxel was read
    shoe: Shoe
    offset_s: float  # what the shoe's clock said at the first frame, and its rate, as the edges agree best
    rate: float
    undone_pa: Array | None = None  # (N, m) what effects known from elsewhere took away

    @property
    def step_s(self) -> float:
        """Between two moments."""
        return float(self.t_s[1] - self.t_s[0])

    @cached_property
    def coefficients(self) -> Array:
        """(k, m) of the static curves, Pa."""
        c = self.calibration.coefficients_pa.reshape(-1, self.calibration.coefficients_pa.shape[-1])[self.slots].T
        return np.concatenate([c, np.zeros((max(2 - len(c), 0), c.shape[1]))])

    @cached_property
    def pressure_pa(self) -> Array:
        """(N, m) by the static model, with what is known from elsewhere undone."""
        static = np.polynomial.polynomial.polyval(self.activation_count, self.coefficients, tensor=False)
        return np.asarray(static if self.undone_pa is None else static + self.undone_pa)

    @cached_property
    def slope_pa(self) -> Array:
        """(N, m) Pa a count, of the static model."""
        steep = self.coefficients[1:] * np.arange(1, len(self.coefficients))[:, None]
        return np.asarray(np.polynomial.polynomial.polyval(self.activation_count, steep, tensor=False))

    @cached_property
    def arms(self) -> Array:
        """(m, 3) what a pascal on each taxel adds to f_z, m_x and m_y."""
        xy = self.layout.xy_m.reshape(-1, 2)[self.slots]
        return self.layout.taxel_area_m2 * np.stack([np.ones(len(xy)), xy[:, 1], -xy[:, 0]], axis=1)

    @cached_property
    def boards(self) -> NDArray[np.intp]:
        """(m,) the board of each taxel."""
        return self.layout.identities[:, 0][self.slots // N_TAXELS].astype(np.intp)

    @cached_property
    def noise(self) -> Array:
        """(3,) standard deviation that the taxels' noise gives the static model's wrench, over the whole walk."""
        of_taxels = np.mean(self.slope_pa**2, axis=0) * self.noise_count**2
        return np.asarray(np.sqrt(of_taxels @ self.arms**2))


def read(recording: Recording, foot: FootRecording, calibration: Calibration, audited: Audit) -> Walk:
    """What is looked at of `foot`; DiagnosisError where its reference tells nothing of it."""
    reference = foot.reference
    assert reference is not None
    if reference.time_s is None:
        raise DiagnosisError(
            f"{recording.folder}: the reference has no time_s: a force shoe's rows cannot be paired with cycles"
        )
    slots = np.flatnonzero((audited.kept & calibration.usable).ravel())
    if not slots.size:
        raise DiagnosisError(f"{recording.folder}: no taxel says anything that can be believed: see the audit")
    t_s = (foot.t_ns - foot.t_ns[0]) * 1e-9
    used = audited.cycles & (np.diff(t_s, prepend=-1.0) > 0)
    period_s = float(np.median(np.diff(t_s)))
    grid_s = np.arange(t_s[used][0], t_s[used][-1], period_s / 2)
    counts = foot.counts.reshape(len(foot), -1)[used]
    valid = foot.valid.reshape(len(foot), -1)[used]
    age_s = np.maximum(foot.age_ns[used], 0) * 1e-9
    at = {row: np.maximum.accumulate(t_s[used] - age_s[:, row]) for row in np.unique(slots // N_TAXELS).tolist()}
    count = np.empty((len(grid_s), len(slots)))
    for column, slot in enumerate(slots.tolist()):
        when, good = at[slot // N_TAXELS], valid[:, slot]
        good = good & (np.diff(when, prepend=-1.0) > 1e-4)
        count[:, column] = CubicSpline(when[good], counts[good, slot])(np.clip(grid_s, *when[good][[0, -1]]))
    after = np.searchsorted(t_s[used], grid_s).clip(1, used.sum() - 1)
    told = np.diff(t_s[used])[after - 1] < MOST_PERIODS * period_s
    baseline = calibration.baseline_count.ravel()[slots]
    wrench = np.stack([reference[name] for name in CHANNELS], axis=1)
    shoe = _shoe(recording, reference.time_s, wrench, reference.clock)
    walk = Walk(
        recording.folder.name, recording.folder, foot.layout, slots, grid_s, period_s, baseline - count, calibration,
        noise_of_readings(counts[:, slots].astype(float)), told, shoe, 0.0, 0.0,
    )  # fmt: skip
    if shoe.clock == "can":
        return replace(walk, offset_s=foot.t_ns[0] * 1e-9 - shoe.epoch_s)
    offset_s, rate = _aligned(walk)
    return replace(walk, offset_s=offset_s, rate=rate)


def _shoe(recording: Recording, time_s: Array, wrench: Array, clock: Clock) -> Shoe:
    """The reference on its grid, by a cubic through its rows; gaps are bridged by it and left out later."""
    there = np.isfinite(wrench).all(axis=1) & (np.diff(time_s, prepend=-np.inf) > 0)
    force = wrench[there, 0]
    moved = float(force.max() - force.min()) if force.size else 0.0
    if len(force) < LEAST_ROWS or not moved > LEAST_FORCE_N:
        raise DiagnosisError(
            f"{recording.folder}: the force of the reference stays within {moved:.0f} N, "
            f"expected one that rises and falls by more than {LEAST_FORCE_N:.0f} N: was the shoe recorded?"
        )
    t, w = time_s[there] - time_s[there][0], wrench[there]
    grid_s = np.arange(0.0, t[-1], FINE_S)
    gaps = t[np.searchsorted(t, grid_s, side="right").clip(1, len(t) - 1)] - t[np.searchsorted(t, grid_s).clip(1) - 1]
    told = gaps < MOST_GAP_S
    return Shoe(
        float(time_s[there][0]),
        CubicSpline(t, w)(grid_s),
        told,
        noise_of_blocks(w),
        float(np.median(np.diff(t))),
        clock,
    )


def _aligned(walk: Walk) -> tuple[float, float]:
    """Offset and rate by the edges; of regular steps half a stride off fits too, with the sign turned."""
    features = walk.pressure_pa @ walk.arms
    shoe = walk.shoe
    every = max(round(0.01 / FINE_S), 1)
    for most_s in (_MOST_OFFSET_S, 5.0, 1.0):
        try:
            found = clocks.fit(walk.t_s, features, shoe.t_s[::every], shoe.wrench[::every], most_offset_s=most_s)
        except CalibrationError as error:
            raise DiagnosisError(f"{walk.folder}: {error}") from error
        said = np.interp(found.reference_s(walk.t_s), shoe.t_s, shoe.wrench[:, 0])
        agrees = float(np.corrcoef(said, features[:, 0])[0, 1])
        if agrees > LEAST_AGREES:
            return found.offset_s, found.rate
    raise DiagnosisError(
        f"{walk.folder}: the force of the reference does not grow with what the {walk.layout.foot} insole reads "
        f"(correlation {agrees:.2f}): is it that of the other foot?"
    )
