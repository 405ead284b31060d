"""Observe a recording against a simulated one of the same trial, whose counts give the load of every taxel.

Rows are the triangles' mean pressures, as in a chamber. The clock between both is found by the edges that all boards
have. The simulation may cover a part of the trial; the load outside it is unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from ...calibration import clock as clocks
from ...errors import CalibrationError, DiagnosisError
from ...physics.calibration import Calibration
from ...physics.law import Array
from ...recording.loading import FootRecording, Recording
from ..operators import low_pass
from .alignment import CLEARLY_LESS, GOOD_FIT, memory_regressors
from .chamber import LEAST_COVERED, ChamberObservation
from .frame_bursts import places_in_bursts
from .grid_readings import read_rows, temperature_at
from .load_field import LoadField, Move, load_field
from .reference_wrench import FINE_S, ReferenceWrench
from .wrench import BETWEEN_ROWS, CHANNELS, CLEAR, cubic_error

MOST_START_S = 20.0  # between the starts of both recordings, beside the difference of their lengths
MATCH_S = 0.5  # of the readings by which a stretch is matched: a part of a step
MOST_UNEVEN = 0.15  # of the load's range, between taxels: in a simulated chamber they differ by less


@dataclass(frozen=True, eq=False)
class PairedObservation(ChamberObservation):
    """One foot against the simulation of its trial; `reference` is the mean load of each of the T triangles, Pa."""

    field: LoadField | None = None  # at the places of the taxels
    simulated: LoadField | None = None  # at the places of the simulation's layout

    @cached_property
    def is_uniform(self) -> bool:  # type: ignore[override]
        """Return whether all taxels bear the same load, as in a simulated chamber."""
        load = self.load_pa(self.reference_s)[:, self.usable]
        mean = load.mean(axis=1, keepdims=True)
        loaded = mean[:, 0] > 0.5 * float(mean.max())
        return bool(np.median(np.abs(load - mean)[loaded]) < MOST_UNEVEN * np.ptp(mean))

    @property
    def least_lag_s(self) -> float:
        """Return the shortest lag that can be identified, which blurs a course more than the interpolation does.

        Between two readings, or two times of the simulation, the load is interpolated. The kernel of linear
        interpolation, a triangle, has the standard deviation period/√6; that of a lag has the standard deviation τ.
        """
        assert self.field is not None
        period_s = max(float(np.median(self.period_s[np.isfinite(self.period_s)])), self.field.period_s)
        return float(period_s / np.sqrt(6.0))

    @cached_property
    def in_bursts_s(self) -> Array:
        """Return where the readings of the recording and of the simulation come in bursts of frames, (2, T), s."""
        assert self.field is not None
        return np.stack([places_in_bursts(self.readings, self.layout.identities[:, 0]), self.field.in_burst_s])

    def load_pa(self, at_s: Array) -> Array:
        """Return the pressure (n, T, 12), Pa, at times (n,) of the simulation's clock, spaced as the rows are."""
        assert self.field is not None
        pressure_pa = self.field.at(at_s)
        if not self.lag_s:
            return pressure_pa
        return low_pass(pressure_pa.reshape(len(pressure_pa), -1), self.step_s, self.lag_s).reshape(pressure_pa.shape)

    def load_less(self, moved_pa: Array, apart_pa: Array | float = 0.0) -> Array:
        """Return the load (N, T, 12) of every taxel, Pa, less the change of its triangle `moved_pa` (N, T) and its own.

        `apart_pa` (N, T, 12) is the change of a taxel beyond that of its triangle.
        """
        return np.asarray(self.load_pa(self.reference_s) - moved_pa[:, :, None] - apart_pa)

    @cached_property
    def expected_count(self) -> Array:
        """Return the activation (N, T, 12) in counts that the static curves have under the simulated load."""
        return self.activation_at(self.load_pa(self.reference_s))

    @cached_property
    def weight_variance(self) -> Array:
        """Return the variance (N, T) of a row, Pa²: as in a chamber, plus the error of interpolation at edges."""
        assert self.field is not None
        variance = super().weight_variance
        load_pa = self.reference.at(self.reference_s)
        period_s = max(float(np.median(self.period_s[np.isfinite(self.period_s)])), self.field.period_s)
        interpolation_error = np.abs(cubic_error(load_pa, self.step_s, period_s))
        interpolation_error = np.maximum(
            interpolation_error - CLEAR * np.sqrt(self.counting_variance[..., 0] + self.reference.noise**2), 0.0
        )
        variance = variance + (BETWEEN_ROWS * maximum_filter1d(interpolation_error, 3, axis=0)) ** 2
        field_row = np.clip(np.rint(self.reference_s / FINE_S), 0, len(self.field.spoiled) - 1).astype(np.intp)
        return np.where(self.field.spoiled[field_row], np.inf, variance)

    def replaced(self, move: Move, swapped: Sequence[tuple[int, int]]) -> PairedObservation:
        """Return the same rows against the field of an insole displaced by `move`, with pairs of triangles `swapped`.

        The displacement is that from the simulation's own layout; displacements of several calls do not add up.
        """
        assert self.simulated is not None
        place_of_row = np.arange(len(self.layout))
        for a, b in swapped:
            place_of_row[[a, b]] = b, a
        return _with_field(self, self.simulated.moved(move, place_of_row))


def _with_field(seen: PairedObservation, field: LoadField) -> PairedObservation:
    """Return the observation against `field`, with the mean loads of triangles as its reference."""
    weights = seen.arms[..., 0]
    mean_pa = field.courses @ np.einsum("tk,tkr->rt", weights, field.shapes)
    noise_pa = np.sqrt(np.sum((weights * field.noise_pa) ** 2, axis=1))
    known = np.ones(len(mean_pa), bool)
    reference = ReferenceWrench(0.0, mean_pa, known, noise_pa, "own", True, field.period_s)
    return replace(seen, field=field, reference=reference)


def observe_paired(
    recording: Recording, foot: FootRecording, calibration: Calibration, simulation: Recording
) -> PairedObservation:
    """Return the observation of `foot` against `simulation`.

    Raises DiagnosisError if the simulation is not of the same insole and trial, or covers too little of it.
    """
    rows = read_rows(recording, foot, calibration, np.median)
    field = load_field(simulation, foot)
    no_reference = ReferenceWrench(0.0, np.zeros((2, 1)), np.zeros(2, bool), np.zeros(1), "own", True, field.period_s)
    observation = PairedObservation(
        name=recording.folder.name, layout=foot.layout, calibration=calibration, t_s=rows.t_s, period_s=rows.period_s,
        activation_count=rows.activation_count, usable=rows.usable, missing=rows.missing, noise_count=rows.noise_count,
        reference=no_reference, offset_s=0.0, rate=0.0, declared_offset_s=None, offset_is_free=True, rate_is_free=True,
        temperature_c=None, readings=rows.readings, simulated=field,
    )  # fmt: skip
    observation = _with_fitted_clock(_with_field(observation, field), recording, foot, simulation)
    covered = float(observation.reference.is_known(observation.reference_s).mean())
    if covered < LEAST_COVERED:
        raise DiagnosisError(
            f"{simulation.folder}: it covers {covered:.0%} of the recording {recording.folder.name}, expected at least "
            f"{LEAST_COVERED:.0%}: simulate the trial that was recorded"
        )
    if foot.reference is not None and foot.reference.clock == "can":
        temperature_c = temperature_at(foot, foot.t_ns[0] * 1e-9, observation.t_s)
        observation = replace(observation, temperature_c=temperature_c)
    return observation


def load_at(seen: PairedObservation, places_m: Array) -> Callable[[Array], Array]:
    """Return a function from times (n, T) since the recording's first frame, s, to pressures (n, T, 12), Pa.

    The pressures are those at the places `places_m` (T, 12, 2). After the end of the simulation they are extrapolated:
    the load of that earlier stretch whose readings were most similar.
    """
    assert seen.field is not None
    field = seen.field.felt_at(places_m)
    last_s = (len(field.courses) - 1) * FINE_S
    missing_s = float(seen.reference_s[-1]) - last_s
    back_s = _match_s(seen, missing_s) if missing_s > 0 else 0.0

    def pressure_at(read_s: Array) -> Array:
        simulated_s = seen.offset_s + (1.0 + seen.rate) * read_s
        simulated_s = np.clip(np.where(simulated_s > last_s, simulated_s - back_s, simulated_s), 0.0, last_s)
        by_triangle = [field.at(simulated_s[:, row])[:, row] for row in range(simulated_s.shape[1])]
        return np.stack(by_triangle, axis=1)

    return pressure_at


def _match_s(seen: PairedObservation, missing_s: float) -> float:
    """Return the time from the stretch of readings most similar to the last `missing_s` + MATCH_S back to the end."""
    count = seen.activation_count[:, seen.usable]
    n_rows = len(count)
    missing_rows, match_rows = (
        int(np.count_nonzero(seen.t_s > seen.t_s[-1] - s)) for s in (missing_s, missing_s + MATCH_S)
    )
    lags = range(missing_rows, n_rows - match_rows)
    if not lags:
        return 0.0
    square_distance = [
        float(np.sum((count[n_rows - match_rows - lag : n_rows - lag] - count[n_rows - match_rows :]) ** 2))
        for lag in lags
    ]
    return float(seen.t_s[-1] - seen.t_s[-1 - lags[int(np.argmin(square_distance))]])


def _with_fitted_clock(
    observation: PairedObservation, recording: Recording, foot: FootRecording, simulation: Recording
) -> PairedObservation:
    """Return the observation on the simulation's clock, by edges of a reference on the CAN clock, else of readings.

    Regressors for the memory of a sensor are fitted beside the edges of the load.
    """
    by_reference = _clock_by_reference(observation, foot)
    if by_reference is not None:
        offset_s, rate = by_reference
        return replace(
            observation.with_clock(offset_s, rate), declared_offset_s=offset_s, offset_is_free=False, rate_is_free=True
        )
    boards = observation.layout.identities[:, 0]
    of_board = [observation.usable & (boards == board)[:, None] for board in np.unique(boards)]
    simulated_s = np.arange(0, len(observation.reference.fine), 4, dtype=np.float64) * FINE_S
    load = np.stack(
        [observation.reference.fine[::4][:, taxels.any(axis=1)].mean(axis=1) for taxels in of_board], axis=1
    )
    scaled_load = (load - load.mean(axis=0)) / np.maximum(load.std(axis=0), 1e-9)
    features = np.concatenate(
        [
            np.ones((len(scaled_load), 1)),
            scaled_load,
            scaled_load**2,
            memory_regressors(simulated_s, scaled_load.mean(axis=1)),
        ],
        axis=1,
    )
    mean_count = np.stack([observation.activation_count[:, taxels].mean(axis=1) for taxels in of_board], axis=1)
    most_offset_s = MOST_START_S + abs(float(np.ptp(observation.t_s)) - float(simulated_s[-1]))
    try:
        fitted = _fit_clock(simulated_s, features, observation.t_s, mean_count, most_offset_s)
    except CalibrationError as error:
        simulated_kpa, recorded_kpa = 1e-3 * observation.reference.fine.max(), 1e-3 * observation.wrench.max()
        raise DiagnosisError(
            f"{simulation.folder}: no stretch of it goes with {recording.folder} ({error}). By their calibrations, the "
            f"simulation has up to {simulated_kpa:.3g} kPa on a triangle, the recording {recorded_kpa:.3g} kPa. "
            f"Expected a simulation of the same trial, which starts at the same instant within {MOST_START_S:.0f} s or "
            "covers a part of it"
        ) from error
    offset_s, rate = _inverted(fitted)
    return replace(observation.with_clock(offset_s, rate), rate_std=fitted.rate_std)


def _clock_by_reference(observation: PairedObservation, foot: FootRecording) -> tuple[float, float] | None:
    """Return offset and rate of the simulation's clock by a reference on the CAN clock, or None without one.

    The reference has no delay of the sensor, so a delay of the whole insole can be identified.
    """
    reference, field = foot.reference, observation.field
    assert field is not None
    if reference is None or reference.time_s is None or reference.clock != "can":
        return None
    xy = field.xy_m
    ones = np.ones(xy.shape[:2])
    names = [name for name in ("pressure_pa", *CHANNELS) if name in reference.columns]
    arms = np.stack([ones, xy[..., 1], -xy[..., 0]][: max(len(names), 1)], axis=-1) * observation.usable[..., None]
    simulated_load = np.asarray(field.courses[::2] @ np.einsum("tkc,tkr->rc", arms, field.shapes), np.float64)
    simulated_s = np.arange(len(simulated_load), dtype=np.float64) * 2 * FINE_S
    recorded_s = reference.time_s - foot.t_ns[0] * 1e-9
    reference_values = np.stack([reference[name] for name in names], axis=1)
    most_offset_s = MOST_START_S + abs(float(np.ptp(recorded_s)) - float(np.ptp(simulated_s)))
    try:
        return _inverted(
            _fit_clock(
                simulated_s, simulated_load, np.asarray(recorded_s, dtype=np.float64), reference_values, most_offset_s
            )
        )
    except CalibrationError:
        return None


def _fit_clock(
    simulated_s: Array, features: Array, recorded_s: Array, values: Array, most_offset_s: float
) -> clocks.Clock:
    """Return the recording's clock by the simulation's, with a rate only if that explains clearly more of the edges."""
    without_rate = clocks.fit_clock(
        simulated_s, features, recorded_s, values, most_offset_s=most_offset_s, most_rate=0.0
    )
    if without_rate.explained > GOOD_FIT:
        return without_rate
    with_rate = clocks.fit_clock(simulated_s, features, recorded_s, values, most_offset_s=most_offset_s)
    return with_rate if 1.0 - with_rate.explained < CLEARLY_LESS * (1.0 - without_rate.explained) else without_rate


def _inverted(clock: clocks.Clock) -> tuple[float, float]:
    """Return offset and rate of the inverse of a clock."""
    rate = 1.0 / (1.0 + clock.rate) - 1.0
    return -clock.offset_s * (1.0 + rate), rate


def swapped_rows(identities: NDArray[np.integer], ids: Sequence[tuple[int, ...]]) -> tuple[int, int]:
    """Return the rows of the two triangles `ids`."""
    triangles = [tuple(identity) for identity in identities.tolist()]
    return triangles.index(tuple(ids[0])), triangles.index(tuple(ids[1]))
