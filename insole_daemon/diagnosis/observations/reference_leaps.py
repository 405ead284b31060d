"""Detect rows in which the reference leaps and the insole does not."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter, percentile_filter

from ...physics.effect import Where
from ..contact import joined, stretches
from ..finding import Finding
from .fault_finding import JOINED_S, make_fault_finding
from .paired import PairedObservation
from .reference_wrench import FINE_S
from .wrench import WrenchObservation

SPIKE_SIGMAS, LEAST_SPIKES, LEAST_LEAPS = 9.0, 4, 3  # leaps: that no pressure could have
LEAP_ROWS = 3  # longest leap, in rows of the reference
COMPARABLE_LEAP = 0.5  # of the usual size: a leap while the insole's force changes
MOST_APART_S = 0.1  # between the clocks of readings and reference


def detect_reference_leaps(seen: WrenchObservation) -> tuple[NDArray[np.bool_], list[Finding]]:
    """Return the rows (N,) in which the reference leaps and the insole does not, and the finding on them.

    A leap lasts a few rows of the reference and deviates from their median by far more than noise and neighbouring rows
    do. At a heel strike the insole's force changes, too. A reference that leaps elsewhere also leaps there: a row that
    deviates as much as the clear ones do, from the insole as well, is one of them.
    """
    if isinstance(seen, PairedObservation):
        return np.zeros(len(seen.t_s), bool), []  # a simulation does not leap
    if seen.load_is_known:
        return np.zeros(len(seen.t_s), bool), _leap_finding(seen)
    width_rows = max(round(LEAP_ROWS * seen.reference.row_s / FINE_S), 1) * 2 + 1
    fine = seen.reference.fine
    deviation = np.abs(fine - median_filter(fine, (width_rows, 1), mode="nearest"))
    usual_deviation = percentile_filter(deviation, 90, (4 * width_rows + round(0.5 / FINE_S) | 1, 1))
    is_leap = (deviation > SPIKE_SIGMAS * seen.reference.noise) & (deviation > 4.0 * usual_deviation)
    # A change of the insole's force about the same time is a heel strike; the clocks may differ by MOST_APART_S.
    near_rows = max(round(MOST_APART_S / seen.step_s), 2)
    insole_range = np.ptp(
        sliding_window_view(np.pad(seen.wrench, ((near_rows, near_rows), (0, 0)), "edge"), 2 * near_rows + 1, 0),
        axis=-1,
    )
    fine_row = np.clip(np.rint(seen.reference_s / FINE_S), 0, len(fine) - 1).astype(np.intp)
    steps = max(round(seen.step_s / FINE_S), 1)
    leap_size = maximum_filter1d(np.where(is_leap, deviation, 0.0), steps, axis=0)[fine_row]
    residual = np.abs(seen.reference.at(seen.reference_s) - seen.wrench)
    residual_nearby = np.sort(np.stack([np.roll(residual, k, axis=0) for k in (-3, -2, 2, 3)]), axis=0)[2]
    is_alone = leap_size > 2.0 * residual_nearby
    spikes = np.any(is_alone & (leap_size > insole_range), axis=1)
    if len(stretches(spikes)) < LEAST_SPIKES:
        return np.zeros(len(spikes), bool), []
    usual_size = np.median(leap_size[spikes], axis=0)
    spikes |= np.any(is_alone & (np.minimum(leap_size, 2.0 * residual) > COMPARABLE_LEAP * usual_size), axis=1)
    times_s = [(float(t), float(t + seen.step_s)) for t in seen.t_s[spikes]]
    text = f"the reference leaps for a moment, {len(stretches(spikes))} times"
    return spikes, [make_fault_finding(seen, "reference_fault", Where(), joined(times_s, JOINED_S)[:40], text)]


def _leap_finding(seen: WrenchObservation) -> list[Finding]:
    """Return the finding on a reference whose leaps were left out, if there are enough."""
    leaps_s = [
        tuple((edge_s - seen.offset_s) / (1.0 + seen.rate) for edge_s in leap) for leap in seen.reference.leaps_s
    ]
    if len(leaps_s) < LEAST_LEAPS:
        return []
    text = f"the reference leaps for a moment, {len(leaps_s)} times"
    return [
        make_fault_finding(seen, "reference_fault", Where(), joined([(a, b) for a, b in leaps_s], JOINED_S)[:40], text)
    ]
