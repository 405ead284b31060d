"""The load that a simulated recording of the same trial tells, with places: a few courses in time, each with a shape.

What presses on a sole is a handful of regions whose force changes, so the pressures of all taxels are few courses
mixed. Readings have noise of their own, each taxel's its own; as a regressor that noise would pass for physics, because
whatever averages it would seem to explain the readings. Keeping the mixtures that stand out of it, as `evidence` does,
takes most of it away without touching time: no filter is left that could be taken for a memory.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ..errors import DiagnosisError
from ..physics.calibration import Calibration
from ..physics.law import Array
from ..physics.static_curve import horner
from ..recording.loading import FootRecording, Recording
from ..recording.read_times import at_cycles
from ..recording.reference import Reference
from ..skin.geometry import N_TAXELS, PRESSURE_TAXELS
from ..skin.layout import Layout
from .floor import noise_of_readings
from .observed import Load

MOST_COURSES = 40
FINER = 2  # rows of the grid for each cycle of the simulation
SAME_PLACE_M = 1e-6
MOST_APART = 0.15  # of the load's range, between taxels: noise and rounding of a simulated chamber are less
MOST_BARE = 0.2  # of the taxels, that a simulation may know nothing of


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """Pressure at k places of an insole over time: `courses` (N, r) on a regular grid times `shapes` (k, r), Pa."""

    layout: Layout
    start_s: float
    step_s: float
    courses: Array
    shapes: Array
    slots: NDArray[np.intp]  # (k,) of the layout, that are known

    @property
    def xy_m(self) -> Array:
        """(k, 2) where they are believed to be."""
        found: Array = self.layout.xy_m.reshape(-1, 2)[self.slots]
        return found

    @property
    def t_s(self) -> Array:
        """(N,) of the rows, on the simulation's clock."""
        return np.asarray(self.start_s + self.step_s * np.arange(len(self.courses)), np.float64)

    def load(self, shapes: Array, age_s: Array) -> Load:
        """The load on m places that have `shapes` (m, r), each `age_s` (m,) earlier, on the simulation's clock."""
        pressure = np.empty((len(self.courses), len(shapes)))
        for age in np.unique(age_s):
            own = age_s == age
            pressure[:, own] = (
                CubicSpline(self.t_s, self.courses)(np.maximum(self.t_s - age, self.start_s)) @ shapes[own].T
            )
        return Load(self.start_s, self.step_s, pressure, "own")


def same_foot(simulation: Recording, foot: FootRecording) -> FootRecording:
    """The foot of the simulation that `foot` is compared with; DiagnosisError where it is another insole."""
    same = next((each for each in simulation.feet if each.foot == foot.foot), None)
    if same is None:
        raise DiagnosisError(
            f"{simulation.folder}: expected a simulation of the {foot.foot} foot, found the "
            f"{' and the '.join(each.foot for each in simulation.feet)}: simulate the insole that was recorded"
        )
    if not np.array_equal(same.layout.identities, foot.layout.identities) or not np.allclose(
        same.layout.xy_m, foot.layout.xy_m, atol=SAME_PLACE_M
    ):
        raise DiagnosisError(
            f"{simulation.folder}: expected a simulation with the layout of the recording, found another: simulate the "
            "insole that was recorded, with the map it is believed to have"
        )
    if same.calibration is None:
        raise DiagnosisError(f"{simulation.folder}: expected a calibration, which tells the load of its counts")
    if same.calibration.effects:
        words = ", ".join(each.law.word for each in same.calibration.effects)
        raise DiagnosisError(f"{simulation.folder}: its calibration has effects ({words}), expected a static one")
    return same


def has_places(simulation: Recording, foot: FootRecording) -> bool:
    """Whether the simulated load differs from taxel to taxel, as in standing and walking."""
    pressure, _, _ = _typical(same_foot(simulation, foot))
    mean = np.nanmean(pressure[~np.isnan(pressure).all(axis=1)], axis=1)
    loaded = mean > (mean.min() + mean.max()) / 2
    apart = np.nanmedian(np.abs(pressure[~np.isnan(pressure).all(axis=1)][loaded] - mean[loaded, None]))
    return bool(apart > MOST_APART * np.ptp(mean))


def uniform_load(simulation: Recording, foot: FootRecording) -> Reference:
    """The load of a simulated chamber, on a clock of its own; DiagnosisError as `same_foot`."""
    same = same_foot(simulation, foot)
    pressure, middle, apart = _typical(same)
    told = ~np.isnan(pressure).all(axis=1)
    t_s = ((same.t_ns - same.t_ns[0]) * 1e-9)[told]
    mean = np.nanmean(np.where(np.abs(pressure[told] - middle[:, None]) < 10 * apart, pressure[told], np.nan), axis=1)
    return Reference(foot.foot, "own", t_s, {"pressure_pa": mean})


def _typical(same: FootRecording) -> tuple[Array, Array, float]:
    """(n, 12 · n_triangles) Pa, (k,) the middle of the cycles that tell any, and how far taxels are from it."""
    assert same.pressure_pa is not None
    pressure = np.where(same.valid, same.pressure_pa, np.nan).reshape(len(same), -1)
    told = ~np.isnan(pressure).all(axis=1)
    middle = np.nanmedian(pressure[told], axis=1)
    return pressure, middle, float(np.nanmedian(np.abs(pressure[told] - middle[:, None])))


def field(simulation: Recording, foot: FootRecording) -> Field:
    """The load that `simulation` tells, at all places it knows; DiagnosisError as `same_foot`."""
    same = same_foot(simulation, foot)
    assert same.calibration is not None
    n = len(same)
    usable = (same.calibration.usable & PRESSURE_TAXELS).ravel()
    slots = np.flatnonzero(usable & (same.valid.reshape(n, -1).mean(axis=0) > 0.5))
    asked = np.flatnonzero(np.tile(PRESSURE_TAXELS, len(same.layout)))
    if len(slots) < (1 - MOST_BARE) * len(asked):
        raise DiagnosisError(
            f"{simulation.folder}: it knows the load of {len(slots)} taxels of {len(asked)}, expected at least "
            f"{1 - MOST_BARE:.0%} of them: its calibration lists too few, or their readings are not valid"
        )
    t_s = (same.t_ns - same.t_ns[0]) * 1e-9
    used = np.diff(t_s, prepend=-1.0) > 0
    t_s = t_s[used]
    new = same.valid & same.is_new[..., None]
    counts, new = (each.reshape(n, -1)[used][:, slots] for each in (same.counts, new))
    behind_s = same.behind_ns[used][:, slots // N_TAXELS] * 1e-9
    pressure, pa_per_count = pressure_of(same.calibration, slots, at_cycles(counts, new, t_s, behind_s))
    scale = noise_of_readings(counts.astype(float), new) * pa_per_count
    left, size, right = np.linalg.svd(pressure / scale, full_matrices=False)
    rows, m = pressure.shape
    # The edge of white noise, in units of a reading's: readings are shifted to common moments, which averages a little.
    r = int(np.clip(np.count_nonzero(size > 1.03 * (np.sqrt(rows) + np.sqrt(m))), 1, MOST_COURSES))
    courses, shapes = left[:, :r] * np.sqrt(rows), right[:r].T * size[:r] / np.sqrt(rows) * scale[:, None]
    step_s = float(np.median(np.diff(t_s))) / FINER
    grid = np.arange(t_s[0], t_s[-1], step_s)
    return Field(foot.layout, float(t_s[0]), step_s, CubicSpline(t_s, courses)(grid), shapes, slots)


def pressure_of(calibration: Calibration, slots: NDArray[np.intp], count: Array) -> tuple[Array, Array]:
    """(n, m) Pa of the counts of the taxels `slots`, and (m,) Pa a count in the middle of what they read."""
    coefficients = calibration.coefficients_pa.reshape(-1, calibration.coefficients_pa.shape[-1])[slots]
    activation = calibration.baseline_count.ravel()[slots] - count
    rows = np.ascontiguousarray(coefficients.T)
    middle = np.sqrt(np.mean(activation**2, axis=0))
    ahead, behind = (horner(rows, (middle + half)[None])[0] for half in (0.5, -0.5))
    return horner(rows, activation), np.maximum(ahead - behind, 1.0)
