"""Readings of all triangles of a foot on one regular time grid.

Counts are interpolated by cubics through the times at which each triangle was read.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...calibration import clock as clocks
from ...errors import DiagnosisError
from ...physics.calibration import Calibration
from ...physics.law import Array
from ...recording.loading import FootRecording, Recording
from ...skin.geometry import N_TAXELS, PRESSURE_TAXELS
from ..floor import noise_of_readings
from .readings import TriangleReadings, read_triangles
from .reference_wrench import LONGEST_S

TEMPERATURE = "temperature_c"
LEAST_ROWS = 100  # of a reference, or of readings whose noise is estimated
MOST_PERIOD_S = 1.0  # between two readings; boards usually send 20 to 100 a second
SLOWEST_S, FASTEST_S = 0.1, 0.02  # of the grid's step


@dataclass(frozen=True, slots=True, eq=False)
class GridReadings:
    """Readings of T triangles on a grid of N rows; the arrays are described at `WrenchObservation`."""

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
    """Return the readings of `foot` on a grid whose step is `period_of` the triangles' periods.

    Raises DiagnosisError if the foot sent too few readings, or its time stamps cover more than a day.
    """
    readings = read_triangles(recording, foot) if len(foot.t_ns) else []
    periods = np.array([triangle.period_s for triangle in readings])
    is_sending = np.isfinite(periods)
    if not is_sending.any():
        raise DiagnosisError(f"{recording.folder}: no triangle of the {foot.foot} foot has sent a reading")
    typical_s = float(np.median(periods[is_sending]))
    if typical_s > MOST_PERIOD_S:
        raise DiagnosisError(
            f"{recording.folder}: a triangle of the {foot.foot} foot sends a reading every {typical_s:.2g} s, expected "
            f"one every {MOST_PERIOD_S:.0f} s at least: were frames lost, and are the times of the log in seconds?"
        )
    step_s = float(np.clip(period_of(periods[is_sending]), FASTEST_S, SLOWEST_S))
    first = max((triangle.t_s[0] for triangle in readings if len(triangle.t_s) and triangle.t_s[0] < 5.0), default=0.0)
    last = float(np.median([triangle.t_s[-1] for triangle in readings if len(triangle.t_s)]))
    if last - first > LONGEST_S:
        raise DiagnosisError(
            f"{recording.folder}: its frames are stamped over {(last - first) / 86_400:.0f} days, expected one trial "
            "of at most a day: the clock of the log was set anew on the way; diagnose the part before or after it"
        )
    grid_s = np.arange(first, last, step_s)
    if len(grid_s) < LEAST_ROWS:
        raise DiagnosisError(
            f"{recording.folder}: the readings of the {foot.foot} foot cover {max(last - first, 0.0):.2g} s, expected "
            f"at least {LEAST_ROWS * step_s:.2g} s: record a trial of a minute"
        )
    counts = np.stack([triangle.at(grid_s) for triangle in readings], axis=1)
    usable = is_sending[:, None] & calibration.usable & PRESSURE_TAXELS & np.isfinite(counts).all(axis=0)
    activation = np.where(usable, calibration.baseline_count - counts, 0.0)
    missing = np.stack([triangle.in_gap(grid_s) for triangle in readings], axis=1)
    noise = np.where(usable, np.stack([noise_of_triangle(triangle) for triangle in readings]), 0.0)
    return GridReadings(grid_s, periods, activation, usable, missing, noise, tuple(readings))


def noise_of_triangle(readings: TriangleReadings) -> Array:
    """Return the standard deviation of a reading of each taxel (12,), counts."""
    if len(readings.t_s) < LEAST_ROWS:
        return np.ones(N_TAXELS)
    return noise_of_readings(readings.counts, readings.valid)


def row_times(foot: FootRecording, time_s: Array | None, rows: int) -> Array:
    """Return the times of a reference's rows (rows,), s: its own, or those of the cycles with the same numbers."""
    if time_s is not None:
        return time_s
    return clocks.row_times_s((foot.t_ns - foot.t_ns[0]) * 1e-9, rows)


def temperature_at(foot: FootRecording, start_s: float, at_s: Array) -> Array | None:
    """Return the temperature (n,) in °C that was recorded with the reference of `foot`, or None if there is none.

    `at_s` (n,): times of the reference's clock, counted from `start_s`.
    """
    reference = foot.reference
    if reference is None or TEMPERATURE not in reference.columns:
        return None
    values = reference[TEMPERATURE]
    known = np.isfinite(values)
    if not known.any():
        return None
    times_s = row_times(foot, reference.time_s, len(values)) - start_s
    return np.interp(at_s, times_s[known], values[known])
