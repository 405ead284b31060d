"""A recording with a force shoe or plate: pressures of all taxels and the reference wrench, on one time grid.

Counts are brought to a regular grid by a cubic through the moments at which each triangle was read. What a gap, a fast
edge or a noisy taxel makes uncertain enters the variance of a row; no row is deleted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from ...calibration import clock as clocks
from ...errors import DiagnosisError
from ...physics.calibration import Calibration
from ...physics.law import Array
from ...recording.document import Clock
from ...recording.loading import FootRecording, Recording
from ...skin.geometry import N_TAXELS, PRESSURE_TAXELS
from ...skin.layout import Layout
from ..floor import noise_of_readings
from ..operators import low_pass, polynomial
from .readings import TriangleReadings, read_triangles

CHANNELS = ("fz_n", "mx_nm", "my_nm")
TEMPERATURE = "temperature_c"
FINE_S = 0.005  # step of the reference's grid
SMOOTH_S = 0.012  # standard deviation of the kernel that takes single rows' noise from columns
LEAST_ROWS = 100  # of the reference
LONGEST_S = 86_400.0  # of a trial
SLOWEST_S, FASTEST_S = 0.1, 0.02  # of the grid's step
JITTER_S = 0.001  # of a stamp that the regular clock of a board does not explain
UNRESOLVED = 0.25  # of the error at twice the period: what a cubic misses on edges that readings hardly resolve
LEAST_LAG_S = 0.004
CLEAR = 3.0  # standard deviations of noise
SMALLEST, LARGEST = 0.6, 254.4  # of the counts that are not cut off
MOST_CLIPPED = 0.2  # of a triangle's taxels
LONG_PAUSE_S = 0.15  # of readings, longer than a straight line can stand for a step
BELOW_RANGE = 0.25  # share of the mean slope: a curve is taken to be no flatter

# Properties that do not depend on the clock.
OF_READINGS = (
    "arms", "by_triangle", "clipped", "coefficients", "cut_off", "pressure_pa", "saturated", "slope_pa", "smooth_count",
)  # fmt: skip
EDGE = 1.05  # times the largest singular value that white noise has


@dataclass(frozen=True, eq=False)
class ReferenceWrench:
    """The reference, by a cubic through its rows on a fine regular grid of its own clock."""

    start_s: float  # what its clock said at the first row; times count from here
    fine: Array  # (M, 3) f_z (N), m_x, m_y (N·m), every FINE_S
    known: NDArray[np.bool_]  # (M,) not in a gap
    noise: Array  # (3,) standard deviation of a row
    clock: Clock
    has_times: bool
    row_s: float  # between two rows
    leaps_s: tuple[tuple[float, float], ...] = ()  # from its first row on, when it was away for a moment: left out

    def at(self, t_s: Array, lag_s: float = 0.0) -> Array:
        """(n, 3) at times `t_s` of its clock, after a first-order lag."""
        values = self.fine if lag_s < FINE_S / 50 else low_pass(self.fine, FINE_S, lag_s)
        return self._interpolated(values, t_s)

    def smooth_at(self, t_s: Array, lag_s: float = 0.0) -> Array:
        """(n, 3) as `at`, of the course without the noise of single rows, for columns of the regression.

        A column that carried the noise of the row it explains would gain by averaging it.
        """
        values = self._smooth if lag_s < FINE_S / 50 else low_pass(self._smooth, FINE_S, lag_s)
        return self._interpolated(values, t_s)

    @cached_property
    def _smooth(self) -> Array:
        return np.asarray(gaussian_filter1d(self.fine, SMOOTH_S / FINE_S, axis=0, mode="nearest"))

    def slope(self, t_s: Array) -> Array:
        """(n, 3) its rate of change at times `t_s`, per second."""
        return self._interpolated(np.gradient(self._smooth, FINE_S, axis=0), t_s)

    def is_known(self, t_s: Array) -> NDArray[np.bool_]:
        """(n,) whether it was recorded at `t_s`."""
        position = t_s / FINE_S
        inside = (position >= 1) & (position <= len(self.fine) - 2)
        near = np.rint(np.clip(position, 0, len(self.fine) - 1)).astype(np.intp)
        return np.asarray(inside & self.known[near])

    def noise_kept(self, lag_s: float) -> float:
        """Share of the variance of white row noise that a first-order lag keeps."""
        if lag_s < FINE_S / 50:
            return 1.0
        x = self.row_s / lag_s
        return float(np.tanh(x / 2.0)) if x < 30 else 1.0

    def echo(self, shift_s: Array, lag_s: float = 0.0) -> tuple[Array, Array]:
        """What noise of variance 1 in every row makes of smooth_at(t) − smooth_at(t − shift) after a lag, (n,) each.

        Its mean product with the noise of the row at t, and its mean square.
        """
        u = np.arange(-400, 801) * (SMOOTH_S / 40)
        kernel = np.exp(-0.5 * (u / SMOOTH_S) ** 2) / (SMOOTH_S * np.sqrt(2 * np.pi))
        late = kernel if lag_s < FINE_S / 50 else low_pass(kernel, float(u[1] - u[0]), lag_s)
        step = float(u[1] - u[0])
        product, square = np.empty(len(shift_s)), np.empty(len(shift_s))
        known: dict[float, tuple[float, float]] = {}
        for i, shift in enumerate(np.round(shift_s, 4).tolist()):
            if shift not in known:
                moved = np.interp(u - shift, u, late, 0.0, 0.0)
                whole = kernel - moved
                known[shift] = (float(np.interp(0.0, u, whole)), float(np.sum(whole**2) * step))
            product[i], square[i] = known[shift]
        return product * self.row_s, square * self.row_s

    def _interpolated(self, values: Array, t_s: Array) -> Array:
        position = np.clip(t_s / FINE_S, 0, len(values) - 1.001)
        left = position.astype(np.intp)
        share = (position - left)[:, None]
        return np.asarray(values[left] * (1 - share) + values[left + 1] * share)


@dataclass(frozen=True, eq=False)
class WrenchObservation:
    """One foot of one recording: N rows on a grid, T triangles of 12 taxels."""

    name: str
    layout: Layout
    calibration: Calibration
    t_s: Array  # (N,) regular, since the recording's first cycle
    period_s: Array  # (T,) between two readings of each triangle
    activation_count: Array  # (N, T, 12) baseline − count; 0 where there is no taxel
    usable: NDArray[np.bool_]  # (T, 12) taxels whose readings are used
    missing: NDArray[np.bool_]  # (N, T) rows in a pause of the triangle's readings
    noise_count: Array  # (T, 12) standard deviation of a reading
    reference: ReferenceWrench
    offset_s: float  # reference clock at t_s = 0, and its rate: the clock the rows are read on
    rate: float
    declared_offset_s: float | None  # where the clock is declared to be the CAN clock, else None
    offset_is_free: bool  # nothing is known of the clock's offset, or what was declared is wrong
    rate_is_free: bool  # the clock's rate is far from 1
    temperature_c: Array | None  # (N,); counts of the thermal pads where no thermometer was recorded
    readings: tuple[TriangleReadings, ...]
    loudness: Array | None = None  # (N, T) times that the noise of readings is larger than `noise_count`
    rezeroed: NDArray[np.bool_] | None = None  # (N, T) rows since a board took its baselines anew, already corrected
    stood_in: NDArray[np.bool_] | None = None  # (T,) triangles whose readings are the mean of others'
    unloaded: NDArray[np.bool_] | None = None  # (N, T, 12) readings at the top of their range: no load, activation 0
    rate_std: float = 0.0  # of the clock's rate, where it is the reference's own
    warmth_is_of_pads: bool = False
    is_estimated: NDArray[np.bool_] | None = None  # (T,) triangles that nobody calibrated, by the curve of the others
    has_own_curves: bool = False  # those that fit the rows best: no calibration was handed in
    load_is_known = False  # on every taxel, and not only in sum
    is_uniform = False  # whether all taxels bear the same load

    @property
    def step_s(self) -> float:
        """Between two rows."""
        return float(self.t_s[1] - self.t_s[0])

    @property
    def least_lag_s(self) -> float:
        """The shortest lag of the whole insole that can be told: less, and readings average the reference's noise."""
        return LEAST_LAG_S

    @property
    def edge_delay_s(self) -> float:
        """By how much the readings' edges are later than those of the load; 0 where nothing tells it."""
        return 0.0

    @property
    def latest_s(self) -> float:
        """By which readings may have been taken earlier than they say: a delay that is none of the insole."""
        return max(each.latest_s for each in self.readings)

    @cached_property
    def clipped(self) -> NDArray[np.bool_]:
        """(N, T) where taxels of a triangle are at the end of their range: that says there is less, not how much."""
        return np.asarray(self.cut_off.sum(axis=2) > MOST_CLIPPED * self.usable.sum(axis=1))

    @cached_property
    def saturated(self) -> NDArray[np.bool_]:
        """(N, T) where a taxel of a triangle bears more than it can say."""
        return np.asarray((self.cut_off & (self.activation_count > 0.5 * np.nanmax(self.activation_count))).any(axis=2))

    @cached_property
    def cut_off(self) -> NDArray[np.bool_]:
        """(N, T, 12) taxels at the end of their range."""
        count = self.calibration.baseline_count - self.activation_count
        refused = np.stack([each.is_refused(self.t_s) for each in self.readings], axis=1)
        ends = (count > LARGEST) | (count < SMALLEST) | refused
        return np.asarray(self.usable & (ends if self.unloaded is None else ends | self.unloaded))

    def with_unloaded(self) -> Self:
        """Without the pull that readings at the top of their range seem to show.

        Nothing pulls at a taxel: such a reading says that there is no load, however far what is warm or was zeroed
        under load has moved it beyond the range.
        """
        count = self.calibration.baseline_count - self.activation_count
        unloaded = np.asarray(self.usable & (count > LARGEST) & (self.activation_count < 0.0))
        if not unloaded.any():
            return self
        return replace(self, activation_count=np.where(unloaded, 0.0, self.activation_count), unloaded=unloaded)

    def nearest(self, row: int) -> NDArray[np.intp]:
        """(T,) triangles by how far their centres are from that of triangle `row`, itself first."""
        centres = self.layout.xy_m.mean(axis=1)
        return np.asarray(np.argsort(np.linalg.norm(centres - centres[row], axis=1)))

    def where_answering(self, values: Array) -> Array:
        """(N, T, 12) `values`, 0 at readings at the top of their range, which no small shift changes."""
        return values if self.unloaded is None else np.where(self.unloaded, 0.0, values)

    @cached_property
    def expected_count(self) -> Array:
        """(N, T, 12) activation that the load should make: where it is not known, the reading."""
        return self.activation_count

    @cached_property
    def arms(self) -> Array:
        """(T, 12, 3) what a pascal on each taxel adds to f_z, m_x and m_y; 0 for taxels that are not used."""
        xy = self.layout.xy_m
        arms = self.layout.taxel_area_m2 * np.stack([np.ones(xy.shape[:2]), xy[..., 1], -xy[..., 0]], axis=-1)
        return np.asarray(arms * self.usable[..., None])

    @cached_property
    def coefficients(self) -> Array:
        """(k, T, 12) of the static curves, Pa; 0 for taxels that are not used."""
        found = np.moveaxis(self.calibration.coefficients_pa, -1, 0) * 1.0
        found = np.concatenate([found, np.zeros((max(2 - len(found), 0), *found.shape[1:]))])
        return np.where(self.usable, found, 0.0)

    @cached_property
    def pressure_pa(self) -> Array:
        """(N, T, 12) by the static curves."""
        return self.static_pa(self.activation_count)

    @cached_property
    def smooth_count(self) -> Array:
        """(N, T, 12) activation with noise reduced.

        Readings of a foot have few independent courses, so singular vectors that do not stand out of white noise are
        left out (edge of the noise's singular values: Marchenko & Pastur, Math. USSR-Sb. 1 (1967) 457).
        """
        usable = self.usable.ravel()
        noise = np.maximum(self.noise_count.ravel()[usable], 0.1)
        raw = self.activation_count.reshape(len(self.t_s), -1)
        scaled = raw[:, usable] / noise
        values, vectors = np.linalg.eigh(scaled.T @ scaled)
        edge = EDGE * (np.sqrt(scaled.shape[0]) + np.sqrt(scaled.shape[1]))
        kept = vectors[:, values > edge**2]
        found = np.zeros_like(raw)
        found[:, usable] = (scaled @ kept) @ kept.T * noise
        return found.reshape(self.activation_count.shape)

    def static_pa(self, activation_count: Array) -> Array:
        """(N, T, 12) Pa by the static curves; outside what was calibrated straight on."""
        inside = self._inside(activation_count)
        found = polynomial(inside, self.coefficients)
        below = np.minimum(activation_count, 0.0)
        below *= self.slope_at(np.zeros((1, *self.usable.shape)))
        found += below
        if self.calibration.highest_count is not None:
            ends = np.where(np.isfinite(self._highest_count), self._highest_count, 0.0)[None]
            found += self.slope_at(ends) * np.maximum(activation_count - self._highest_count, 0.0)
        return np.asarray(found)

    @cached_property
    def slope_pa(self) -> Array:
        """(N, T, 12) Pa a count, at the reading."""
        return self.where_answering(self.slope_at(self.activation_count))

    def slope_at(self, activation_count: Array) -> Array:
        """(N, T, 12) Pa a count at an activation, no flatter than a share of the taxel's mean."""
        steep = self.coefficients[1:] * np.arange(1, len(self.coefficients))[:, None, None]
        found = polynomial(self._inside(activation_count), steep)
        least = BELOW_RANGE * np.mean(found, axis=0)
        return np.asarray(np.maximum(found, np.maximum(least, 0.0), out=found))

    @property
    def _highest_count(self) -> Array:
        """(T, 12) activation up to which the curves were fitted."""
        highest = np.inf if self.calibration.highest_count is None else self.calibration.highest_count
        return np.asarray(np.where(self.usable, highest, np.inf))

    def _inside(self, activation_count: Array) -> Array:
        """The nearest activation that was calibrated."""
        return np.asarray(np.clip(activation_count, 0.0, self._highest_count))

    @cached_property
    def by_triangle(self) -> Array:
        """(N, T, 3) wrench of each triangle by the static curves."""
        return self.wrench_of(self.pressure_pa)

    @property
    def wrench(self) -> Array:
        """(N, 3) of the insole by the static curves."""
        return np.asarray(self.by_triangle.sum(axis=1))

    @property
    def square_error(self) -> Array:
        """(3,) mean square of the wrench by the static curves less the reference, N² and N²·m²."""
        known = self.reference.is_known(self.reference_s)
        return np.asarray(np.mean((self.wrench - self.reference.smooth_at(self.reference_s))[known] ** 2, axis=0))

    def wrench_of(self, pressure_pa: Array) -> Array:
        """(N, T, 3) wrench of each triangle for pressures (N, T, 12)."""
        return np.asarray(np.matmul(pressure_pa.transpose(1, 0, 2), self.arms).transpose(1, 0, 2))

    @cached_property
    def reference_s(self) -> Array:
        """(N,) the reference's clock at every row."""
        return self.offset_s + (1.0 + self.rate) * self.t_s

    def with_clock(self, offset_s: float, rate: float) -> Self:
        """The same rows, with the reference read on another clock."""
        return self.timed(offset_s=offset_s, rate=rate)

    def timed(self, **clock: Any) -> Self:
        """The same rows with other fields of the `clock`; of what is computed, what readings alone tell is kept."""
        found = replace(self, **clock)
        vars(found).update({name: known for name, known in vars(self).items() if name in OF_READINGS})
        return found

    def until(self, row: int) -> Self:
        """Without that row and later ones."""
        by_row = ("t_s", "activation_count", "missing", "temperature_c", "loudness", "rezeroed", "unloaded")
        return replace(self, **{name: own[:row] for name in by_row if (own := getattr(self, name)) is not None})

    @cached_property
    def counting_variance(self) -> Array:
        """(N, T, 3) variance of each triangle's wrench by the noise of its readings."""
        return self.variance_of((self.slope_pa * self.noise_count) ** 2)

    def variance_of(self, variance_pa2: Array) -> Array:
        """(N, T, 3) variance of each triangle's wrench by that of its taxels (N, T, 12), as they are usually."""
        found = np.asarray(np.matmul(variance_pa2.transpose(1, 0, 2), self.arms**2).transpose(1, 0, 2))
        return found if self.loudness is None else found * self.loudness[..., None] ** 2

    @cached_property
    def unresolved(self) -> dict[int, Array]:
        """By board (N, 3): what a cubic through its reading times makes of the reference, less the reference.

        Where that is no more than the reference's noise it is 0: a column of noise would average noise.
        """
        boards = self.layout.identities[:, 0]
        said = self.reference.smooth_at(self.reference_s)
        found = {}
        for board in np.unique(boards):
            own = next((self.readings[row].t_s for row in np.flatnonzero(boards == board)), np.empty(0))
            if len(own) < LEAST_ROWS:
                continue
            values = self.reference.smooth_at(self.offset_s + (1.0 + self.rate) * own)
            at_s = np.clip(self.t_s, own[0], own[-1])
            error = CubicSpline(own, values)(at_s) - said
            found[int(board)] = np.where(np.abs(error) > CLEAR * self.reference.noise, error, 0.0)
        return found

    @cached_property
    def weight_variance(self) -> Array:
        """(N, 3) variance of a row that counting noise, stamps, interpolation and gaps make, wrench units²."""
        counted = self.counting_variance.sum(axis=1)
        boards = self.layout.identities[:, 0]
        edges = np.zeros_like(counted)
        for board in np.unique(boards):
            own = boards == board
            course = self.by_triangle[:, own].sum(axis=1)
            slope = np.gradient(course, self.step_s, axis=0)
            period_s = float(np.median(self.period_s[own]))
            error = np.abs(foretold(course, self.step_s, period_s)) if np.isfinite(period_s) else np.zeros_like(course)
            error = np.maximum(error - CLEAR * np.sqrt(self.counting_variance[:, own].sum(axis=1)), 0.0)
            edges += (JITTER_S * slope) ** 2 + (UNRESOLVED * maximum_filter1d(error, 3, axis=0)) ** 2
        lost = np.einsum("nt,ntc->nc", self.missing, self.by_triangle**2) * 0.25
        # What a step has done meanwhile nobody knows, and it is the same of all triangles of a board.
        paused = np.stack([each.in_gap(self.t_s, LONG_PAUSE_S) for each in self.readings], axis=1)
        lost += (paused.astype(np.float64) @ np.sqrt(np.mean(self.by_triangle**2, axis=0))) ** 2
        found = counted + self.reference.noise**2 + edges + lost
        unknown = ~self.reference.is_known(self.reference_s)
        found[unknown] = np.inf
        return np.asarray(found)


@dataclass(frozen=True, slots=True, eq=False)
class GridReadings:
    """Readings of T triangles on a grid of N rows; arrays as `WrenchObservation` has them."""

    t_s: Array
    period_s: Array
    activation_count: Array
    usable: NDArray[np.bool_]
    missing: NDArray[np.bool_]
    noise_count: Array
    readings: tuple[TriangleReadings, ...]


def read_rows(
    recording: Recording, foot: FootRecording, calibration: Calibration, period_of: Callable[[Array], np.floating]
) -> GridReadings:
    """Readings of `foot` at a step that is `period_of` the triangles' periods; DiagnosisError where it sent none."""
    readings = read_triangles(recording, foot)
    periods = np.array([each.period_s for each in readings])
    there = np.isfinite(periods)
    if not there.any():
        raise DiagnosisError(f"{recording.folder}: no triangle of the {foot.foot} foot has sent a reading")
    step_s = float(np.clip(period_of(periods[there]), FASTEST_S, SLOWEST_S))
    first = max((each.t_s[0] for each in readings if len(each.t_s) and each.t_s[0] < 5.0), default=0.0)
    last = float(np.median([each.t_s[-1] for each in readings if len(each.t_s)]))
    if last - first > LONGEST_S:
        raise DiagnosisError(
            f"{recording.folder}: its frames are stamped over {(last - first) / 86_400:.0f} days, expected one trial "
            "of at most a day: the clock of the log was set anew on the way; diagnose the part before or after it"
        )
    grid_s = np.arange(first, last, step_s)
    counts = np.stack([each.at(grid_s) for each in readings], axis=1)
    usable = there[:, None] & calibration.usable & PRESSURE_TAXELS & np.isfinite(counts).all(axis=0)
    activation = np.where(usable, calibration.baseline_count - counts, 0.0)
    missing = np.stack([each.in_gap(grid_s) for each in readings], axis=1)
    noise = np.where(usable, np.stack([noise_of_triangle(each) for each in readings]), 0.0)
    return GridReadings(grid_s, periods, activation, usable, missing, noise, tuple(readings))


def noise_of_triangle(readings: TriangleReadings) -> Array:
    """(12,) standard deviation of one reading of each taxel."""
    if len(readings.t_s) < LEAST_ROWS:
        return np.ones(N_TAXELS)
    return noise_of_readings(readings.counts, readings.valid)


def row_times(foot: FootRecording, time_s: Array | None, rows: int) -> Array:
    """(rows,) of a reference: its own times, or else those of the cycles of the same number, s."""
    if time_s is not None:
        return time_s
    return clocks.row_times_s((foot.t_ns - foot.t_ns[0]) * 1e-9, rows)


def foretold(own: Array, step_s: float, period_s: float) -> Array:
    """(N, 3) of a course known every `period_s`: how far a row is off what those one and three periods away foretell.

    Between two readings, which are half as far, a cubic is off by less: by how much, depends on how well the readings
    resolve the course; by a quarter of it where they hardly do.
    """
    k = 3 * max(round(period_s / step_s), 1)
    error = np.zeros_like(own)
    near = own[2 * k // 3 : len(own) - 4 * k // 3] + own[4 * k // 3 : len(own) - 2 * k // 3]
    far = own[: len(own) - 2 * k] + own[2 * k :]
    error[k:-k] = own[k:-k] - (9.0 * near - far) / 16.0
    return error
