"""Detect faults that have no effect word, from the readings alone; they are reported as `unknown`.

These are a bit of the counts that never changes, and electrical pick-up: a swing that all taxels of a triangle have at
once, such as hum of the mains aliased by the sampling.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from .readings import TriangleReadings
from .wrench import LARGEST, SMALLEST

N_BITS = 7  # lowest bits of a count that can be judged: the highest bit needs more than the range of a count
LEAST_SPAN = 4  # range of a taxel's counts, in values of the bit, within which the bit has to change
LEAST_READINGS = 100  # between the ends of that range
LEAST_TAXELS = 3  # of a triangle
WINDOW_READINGS = 8  # shorter than a step
CALM_QUANTILE = 0.1  # over windows: an edge of the load moves all taxels at once, too
USUAL_QUANTILE = 0.25  # over windows, of the noise by pick-up
LEAST_VARIANCE = 0.05  # of noise, counts²: rounding alone
LEAST_RATIO, MOST_USUAL_RATIO = 6.0, 1.5  # of a triangle with pick-up, and of most triangles; independent noise has 1


def stuck_bit(readings: TriangleReadings, usable: NDArray[np.bool_]) -> int | None:
    """Return the bit that never changes in a triangle although its counts pass both of its values, or None.

    `usable` (12,) are the taxels that are judged.
    """
    as_read = readings.as_read
    for bit in range(N_BITS):
        bit_value, constant_taxels = 1 << bit, 0
        for taxel in np.flatnonzero(usable).tolist():
            counts = readings.counts[as_read[:, taxel], taxel].astype(np.int64)
            if not len(counts) or np.ptp(counts) < LEAST_SPAN * bit_value:
                continue
            inside = (counts > counts.min() + bit_value) & (counts < counts.max() - bit_value)
            if np.count_nonzero(inside) < LEAST_READINGS:
                continue
            if np.ptp((counts >> bit) & 1):
                constant_taxels = 0
                break
            constant_taxels += 1
        if constant_taxels >= LEAST_TAXELS:
            return bit
    return None


def is_bit_constant(readings: TriangleReadings, usable: NDArray[np.bool_], bit: int) -> bool:
    """Return whether a bit is the same in all readings of a triangle, whatever the range of its counts."""
    counts = readings.counts[readings.as_read & usable].astype(np.int64)
    return bool(len(counts) and not np.ptp((counts >> bit) & 1))


def common_variance_ratios(readings: TriangleReadings, usable: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the variance of the mean of a triangle's taxels over that of independent taxels; NaN if it is unknown.

    The first value is that of calm windows, the second that of usual ones. The variances are of third differences,
    which contain noise and hardly any load.
    """
    counts = readings.counts[:, usable]
    n_windows = (len(counts) - 3) // WINDOW_READINGS
    if n_windows < 4:
        return np.nan, np.nan
    in_range = ((counts > SMALLEST) & (counts < LARGEST)).mean(axis=0) > 0.5
    if in_range.sum() < LEAST_TAXELS:
        return np.nan, np.nan
    fast = np.diff(counts[:, in_range], n=3, axis=0)[: n_windows * WINDOW_READINGS] / np.sqrt(20.0)
    n_taxels = fast.shape[1]
    mean = fast.mean(axis=1)
    shared = np.mean(mean.reshape(n_windows, WINDOW_READINGS) ** 2, axis=1)
    independent = np.mean((fast - mean[:, None]).reshape(n_windows, -1) ** 2, axis=1) * n_taxels / (n_taxels - 1)
    ratios = n_taxels * shared / np.maximum(independent, LEAST_VARIANCE)
    calm, usual = np.quantile(ratios, (CALM_QUANTILE, USUAL_QUANTILE)).tolist()
    return calm, usual


def detect_pick_up(ratios: Array) -> NDArray[np.bool_]:
    """Return the triangles (T,) whose taxels swing at once, by their `ratios` (T,) of calm windows.

    None if most triangles have a high ratio: then the load itself moves the taxels together.
    """
    known = np.isfinite(ratios)
    if not known.any() or float(np.median(ratios[known])) > MOST_USUAL_RATIO:
        return np.zeros(len(ratios), bool)
    return np.asarray(known & (np.where(known, ratios, 0.0) > LEAST_RATIO))
