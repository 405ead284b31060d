"""A recording beside a simulated one of the same trial: the load of every taxel is what simulated counts say.

Rows are the triangles' mean pressures, as in a chamber. The clock between both is found by the edges that all boards
see; the simulation may cover a part of the trial, and what it does not tell is not known.
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
from .alignment import SHARPER, SURE, late_parts
from .chamber import LEAST_TOLD, ChamberObservation
from .load_field import LoadField, Move, load_field
from .wrench import (
    CHANNELS,
    CLEAR,
    FINE_S,
    TEMPERATURE,
    UNRESOLVED,
    ReferenceWrench,
    foretold,
    read_rows,
    row_times,
)  # fmt: skip

START_S = 20.0  # by which both may begin apart, beside what one is longer than the other
ALIKE_S = 0.5  # some of a step
UNIFORM = 0.15  # of the load's range, between taxels: a simulated chamber differs by less


@dataclass(frozen=True, eq=False)
class PairedObservation(ChamberObservation):
    """One foot beside the simulation of its trial; `reference` has the mean load of each of the T triangles."""

    field: LoadField | None = None

    @cached_property
    def is_uniform(self) -> bool:  # type: ignore[override]
        """Whether all taxels bear the same load, as in a simulated chamber."""
        load = self.load_pa(self.reference_s)[:, self.usable]
        mean = load.mean(axis=1, keepdims=True)
        loaded = mean[:, 0] > 0.5 * float(mean.max())
        return bool(np.median(np.abs(load - mean)[loaded]) < UNIFORM * np.ptp(mean))

    @property
    def least_lag_s(self) -> float:
        """As long as two readings of either are apart: the course between them is a guess on both sides."""
        assert self.field is not None
        return max(float(np.median(self.period_s[np.isfinite(self.period_s)])), self.field.period_s)

    def load_pa(self, at_s: Array) -> Array:
        """(n, T, 12) pressure on the taxels at times (n,) of the simulation's clock, as far apart as rows are."""
        assert self.field is not None
        found = self.field.at(at_s)
        if not self.lag_s:
            return found
        return low_pass(found.reshape(len(found), -1), self.step_s, self.lag_s).reshape(found.shape)

    def load_less(self, moved_pa: Array, apart_pa: Array | float = 0.0) -> Array:
        """(N, T, 12) load of every taxel at its rows, less what its triangle is moved by (N, T), and what it is itself.

        `apart_pa` (N, T, 12): by which taxels are moved more than their triangle.
        """
        return np.asarray(self.load_pa(self.reference_s) - moved_pa[:, :, None] - apart_pa)

    @cached_property
    def expected_count(self) -> Array:
        """(N, T, 12) activation by the static curves under the simulated load."""
        return self.activation_at(self.load_pa(self.reference_s))

    @cached_property
    def weight_variance(self) -> Array:
        """(N, T) as in a chamber, and what is not known of edges between two readings."""
        assert self.field is not None
        found = super().weight_variance
        course = self.reference.at(self.reference_s)
        period_s = max(float(np.median(self.period_s[np.isfinite(self.period_s)])), self.field.period_s)
        error = np.abs(foretold(course, self.step_s, period_s))
        error = np.maximum(error - CLEAR * np.sqrt(self.counting_variance[..., 0] + self.reference.noise**2), 0.0)
        found = found + (UNRESOLVED * maximum_filter1d(error, 3, axis=0)) ** 2
        nearest = np.clip(np.rint(self.reference_s / FINE_S), 0, len(self.field.spoiled) - 1).astype(np.intp)
        return np.where(self.field.spoiled[nearest], np.inf, found)

    def replaced(self, move: Move, swapped: Sequence[tuple[int, int]]) -> PairedObservation:
        """The same rows against what the simulation's field says where the taxels are; pairs of rows that `swapped`.

        Of the field as loaded: moves do not add up over calls.
        """
        assert self.field is not None
        rows = np.arange(len(self.layout))
        for a, b in swapped:
            rows[[a, b]] = b, a
        return _with_means(self, self.field.moved(move, rows))


def _with_means(seen: PairedObservation, field: LoadField) -> PairedObservation:
    weights = seen.arms[..., 0]
    means = field.courses @ np.einsum("tk,tkr->rt", weights, field.shapes)
    noise = np.sqrt(np.sum((weights * field.noise_pa) ** 2, axis=1))
    known = np.ones(len(means), bool)
    reference = ReferenceWrench(0.0, means, known, noise, "own", True, field.period_s)
    return replace(seen, field=field, reference=reference)


def observe_paired(
    recording: Recording, foot: FootRecording, calibration: Calibration, simulation: Recording
) -> PairedObservation:
    """What is looked at of `foot` beside `simulation`; DiagnosisError where that is not of the same trial."""
    rows = read_rows(recording, foot, calibration, np.median)
    field = load_field(simulation, foot)
    nothing = ReferenceWrench(0.0, np.zeros((2, 1)), np.zeros(2, bool), np.zeros(1), "own", True, field.period_s)
    found = PairedObservation(
        recording.folder.name, foot.layout, calibration, rows.t_s, rows.period_s, rows.activation_count, rows.usable,
        rows.missing, rows.noise_count, nothing, 0.0, 0.0, None, True, True, None, rows.readings,
    )  # fmt: skip
    found = _aligned(_with_means(found, field), recording, foot, simulation)
    told = float(found.reference.is_known(found.reference_s).mean())
    if told < LEAST_TOLD:
        raise DiagnosisError(
            f"{simulation.folder}: it covers {told:.0%} of the recording {recording.folder.name}, expected at least "
            f"{LEAST_TOLD:.0%}: simulate the trial that was recorded"
        )
    reference = foot.reference
    if reference is not None and TEMPERATURE in reference.columns and reference.clock == "can":
        values = reference[TEMPERATURE]
        known = np.isfinite(values)
        if known.any():
            times_s = row_times(foot, reference.time_s, len(values)) - foot.t_ns[0] * 1e-9
            found = replace(found, temperature_c=np.interp(found.t_s, times_s[known], values[known]))
    return found


def load_at(seen: PairedObservation, places_m: Array) -> Callable[[Array], Array]:
    """What gives the (n, T, 12) Pa at the places (T, 12, 2), of (n, T) moments since the recording's first frame.

    What comes after the end of the simulation is a guess: the load of that earlier stretch whose readings were most
    alike.
    """
    assert seen.field is not None
    field = seen.field.felt_at(places_m)
    last_s = (len(field.courses) - 1) * FINE_S
    missing_s = float(seen.reference_s[-1]) - last_s
    back_s = _alike_s(seen, missing_s) if missing_s > 0 else 0.0

    def at(read_s: Array) -> Array:
        its_s = seen.offset_s + (1.0 + seen.rate) * read_s
        its_s = np.clip(np.where(its_s > last_s, its_s - back_s, its_s), 0.0, last_s)
        every = [field.at(its_s[:, row])[:, row] for row in range(its_s.shape[1])]
        return np.stack(every, axis=1)

    return at


def _alike_s(seen: PairedObservation, missing_s: float) -> float:
    """How long before its end the recording read what is most like its last `missing_s` with ALIKE_S before."""
    read = seen.activation_count[:, seen.usable]
    n = len(read)
    last, rows = (int(np.count_nonzero(seen.t_s > seen.t_s[-1] - s)) for s in (missing_s, missing_s + ALIKE_S))
    back = range(last, n - rows)
    if not back:
        return 0.0
    apart = [float(np.sum((read[n - rows - each : n - each] - read[n - rows :]) ** 2)) for each in back]
    return float(seen.t_s[-1] - seen.t_s[-1 - back[int(np.argmin(apart))]])


def _aligned(
    found: PairedObservation, recording: Recording, foot: FootRecording, simulation: Recording
) -> PairedObservation:
    """The simulation's clock: by the edges of a reference on the CAN clock, else by those of readings.

    What a sensor with memory may add to the load is fitted beside its edges.
    """
    by_reference = _by_reference(found, foot)
    if by_reference is not None:
        offset_s, rate = by_reference
        return replace(
            found.with_clock(offset_s, rate), declared_offset_s=offset_s, offset_is_free=False, rate_is_free=True
        )
    boards = found.layout.identities[:, 0]
    own = [found.usable & (boards == board)[:, None] for board in np.unique(boards)]
    its_s = np.arange(0, len(found.reference.fine), 4, dtype=np.float64) * FINE_S
    load = np.stack([found.reference.fine[::4][:, part.any(axis=1)].mean(axis=1) for part in own], axis=1)
    x = (load - load.mean(axis=0)) / np.maximum(load.std(axis=0), 1e-9)
    features = np.concatenate([np.ones((len(x), 1)), x, x**2, late_parts(its_s, x.mean(axis=1))], axis=1)
    read = np.stack([found.activation_count[:, part].mean(axis=1) for part in own], axis=1)
    most_s = START_S + abs(float(np.ptp(found.t_s)) - float(its_s[-1]))
    try:
        fitted = _fitted(its_s, features, found.t_s, read, most_s)
    except CalibrationError as error:
        raise DiagnosisError(
            f"{simulation.folder}: no stretch of it goes with {recording.folder} ({error}): expected a simulation of "
            f"the same trial, which starts at the same instant within {START_S:.0f} s or covers a part of it"
        ) from error
    offset_s, rate = _inverted(fitted)
    return replace(found.with_clock(offset_s, rate), rate_std=fitted.rate_std)


def _by_reference(found: PairedObservation, foot: FootRecording) -> tuple[float, float] | None:
    """Offset and rate of the simulation's clock where a reference on the CAN clock has its edges; None: there is none.

    A reference is not late with the sensor, so what all of the insole is late by can then be told.
    """
    reference, field = foot.reference, found.field
    assert field is not None
    if reference is None or reference.time_s is None or reference.clock != "can":
        return None
    xy = field.xy_m
    ones = np.ones(xy.shape[:2])
    names = [name for name in ("pressure_pa", *CHANNELS) if name in reference.columns]
    arms = np.stack([ones, xy[..., 1], -xy[..., 0]][: max(len(names), 1)], axis=-1) * found.usable[..., None]
    load = np.asarray(field.courses[::2] @ np.einsum("tkc,tkr->rc", arms, field.shapes), np.float64)
    its_s = np.arange(len(load), dtype=np.float64) * 2 * FINE_S
    my_s = reference.time_s - foot.t_ns[0] * 1e-9
    read = np.stack([reference[name] for name in names], axis=1)
    most_s = START_S + abs(float(np.ptp(my_s)) - float(np.ptp(its_s)))
    try:
        return _inverted(_fitted(its_s, load, np.asarray(my_s, dtype=np.float64), read, most_s))
    except CalibrationError:
        return None


def _fitted(its_s: Array, features: Array, my_s: Array, read: Array, most_s: float) -> clocks.Clock:
    """The recording's clock by the simulation's; a rate only where it explains clearly more."""
    held = clocks.fit_clock(its_s, features, my_s, read, most_offset_s=most_s, most_rate=0.0)
    if held.explained > SURE:
        return held
    free = clocks.fit_clock(its_s, features, my_s, read, most_offset_s=most_s)
    return free if 1.0 - free.explained < SHARPER * (1.0 - held.explained) else held


def _inverted(clock: clocks.Clock) -> tuple[float, float]:
    rate = 1.0 / (1.0 + clock.rate) - 1.0
    return -clock.offset_s * (1.0 + rate), rate


def swapped_rows(identities: NDArray[np.integer], ids: Sequence[tuple[int, ...]]) -> tuple[int, int]:
    """Rows of the two triangles `ids`."""
    every = [tuple(each) for each in identities.tolist()]
    return every.index(tuple(ids[0])), every.index(tuple(ids[1]))
