"""Where the readings of each triangle come in a burst of frames.

Boards may take all readings at once and send them one after the other, or take each when they send it. The stamps of
frames do not tell which.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from .bus_waits import BUSY_S
from .readings import LEAST_READINGS, TriangleReadings

FIXED_S = 2e-4  # median deviation of the time between the readings of two triangles that come in one burst
GAP_S = 2.0 * BUSY_S  # between readings of two bursts; a reading has two frames


def places_in_bursts(readings: Sequence[TriangleReadings], boards: NDArray[np.integer]) -> Array:
    """Return how long after the first readings of their burst those of each triangle come, (T,), s.

    `boards` (T,): their addresses. Boards whose clocks drift against each other have bursts of their own. 0 for a
    triangle without readings.
    """
    places = np.zeros(len(readings))
    rows = np.array([row for row, each in enumerate(readings) if len(each.t_s) >= LEAST_READINGS], np.intp)
    if not len(rows):
        return places
    after_s, deviation_s = _after(readings, rows)
    if np.all(deviation_s < FIXED_S):
        groups = [(rows, after_s)]
    else:
        groups = [
            (own, _after(readings, own)[0])
            for own in (rows[boards[rows] == board] for board in np.unique(boards[rows]))
        ]
    for own, phase_s in groups:
        order = np.argsort(phase_s)
        is_first = np.diff(phase_s[order], prepend=-np.inf) > GAP_S
        starts_s = phase_s[order][is_first][np.cumsum(is_first) - 1]
        places[own[order]] = phase_s[order] - starts_s
    return places


def _after(readings: Sequence[TriangleReadings], rows: NDArray[np.intp]) -> tuple[Array, Array]:
    """Return how long after the nearest readings of the first of `rows` those of each come, and the deviation, s."""
    first_s = readings[rows[0]].t_s
    middles_s = 0.5 * (first_s[1:] + first_s[:-1])
    differences = [readings[row].t_s - first_s[np.searchsorted(middles_s, readings[row].t_s)] for row in rows]
    medians = np.array([float(np.median(each)) for each in differences])
    deviations = [float(np.median(np.abs(each - median))) for each, median in zip(differences, medians, strict=True)]
    return medians, np.array(deviations)
