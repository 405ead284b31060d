"""Warnings where the recordings of a calibration are unlike the walk that it will be used for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from .samples import Samples

WALKING_PA = 300_000.0  # a walking person often presses a taxel this much
SAME_SPEED_RATIO = 1.5  # of the fastest ramp to the slowest, below which they count as one speed
MANY_LEFT_OUT = 0.1  # of the pressure taxels

Array = NDArray[np.float64]


def coverage_warnings(samples: Sequence[Samples], known_pa: Array, n_left_out: int) -> tuple[str, ...]:
    """Return a sentence for each way in which the recordings do not cover a walk.

    `known_pa` (m,) is the pressure up to which the curve of each taxel is known; `n_left_out` taxels have no curve.
    """
    return tuple(_warnings(samples, known_pa, n_left_out))


def _warnings(samples: Sequence[Samples], known_pa: Array, n_left_out: int) -> Iterator[str]:
    speeds_pa_s = [
        ramp_speeds_pa_s(recorded.trial.readings.t_s, recorded.trial.readings.values[:, 0]) for recorded in samples
    ]
    if all(recorded.trial.kind == "chamber" for recorded in samples) and _is_one_speed(np.concatenate(speeds_pa_s)):
        speed_kpa_s = float(np.median(np.concatenate(speeds_pa_s))) / 1e3
        yield (
            f"the pressure changes at one speed only, {speed_kpa_s:.2g} kPa/s: the curves contain the memory of the "
            "material at that speed, and forces of a walk, which is faster, may be far off: add cycles at another "
            "speed, or a walk in force shoes"
        )
    highest_pa = float(np.median(known_pa))
    if highest_pa < WALKING_PA:
        yield (
            f"the curves are known up to {highest_pa / 1e3:.0f} kPa (median of the taxels) and extrapolated beyond; a "
            f"walk presses {WALKING_PA / 1e3:.0f} kPa and more: add a walk in force shoes, or a chamber that reaches it"
        )
    total = len(known_pa) + n_left_out
    if n_left_out > MANY_LEFT_OUT * total:
        yield (
            f"{n_left_out} of {total} taxels have no curve, and forces are short by what they bear: add a chamber "
            "trial, or one in which the whole sole is pressed"
        )


def ramp_speeds_pa_s(t_s: Array, pressure_pa: Array) -> Array:
    """Return the mean speed of every ramp across the middle half of the range of `pressure_pa` (k,) at `t_s` (k,)."""
    known = np.isfinite(pressure_pa)
    t_s, pressure_pa = t_s[known], pressure_pa[known]
    level = np.digitize((pressure_pa - pressure_pa.min()) / max(float(np.ptp(pressure_pa)), 1e-9), (0.25, 0.75))
    ends = np.flatnonzero(level != 1)  # at the bottom or at the top
    ramps = np.flatnonzero(np.diff(level[ends]))
    first, last = ends[ramps], ends[ramps + 1]
    speeds: Array = np.abs(pressure_pa[last] - pressure_pa[first]) / np.maximum(t_s[last] - t_s[first], 1e-9)
    return speeds


def _is_one_speed(speeds_pa_s: Array) -> bool:
    return len(speeds_pa_s) > 0 and float(speeds_pa_s.max()) <= SAME_SPEED_RATIO * float(speeds_pa_s.min())
