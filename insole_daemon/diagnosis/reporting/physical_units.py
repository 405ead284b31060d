"""Convert errors in counts to pressures and forces, by the slope of the curves in use at each reading."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...physics.law import Array
from ..result import RecordingResult


def pa_per_count(result: RecordingResult) -> Array:
    """Return Pa per count in each row (N,): the mean slope of the curves of the usable taxels."""
    seen = result.seen
    return np.asarray(np.sum(seen.slope_pa * seen.usable, axis=(1, 2)) / max(int(seen.usable.sum()), 1))


def course_pa(result: RecordingResult, course_count: Array) -> Array:
    """Return the mean error of all taxels (N,) in Pa, from its course (N, 1) in counts."""
    return np.asarray(course_count[:, 0] * pa_per_count(result))


def rms_kpa(results: Sequence[RecordingResult], rms_count: float) -> float:
    """Return an RMS error of single readings in kPa, from counts: by the RMS slope over all rows of known load."""
    slopes = np.concatenate([pa_per_count(result)[result.figures.known] for result in results])
    return float(rms_count * np.sqrt(np.mean(slopes**2)) * 1e-3)


def rms_force_n(results: Sequence[RecordingResult]) -> tuple[float, float]:
    """Return RMS errors of the force of all taxels together, before and after, in N: of held-out rows."""
    return _rms_force_n(results, "course_before"), _rms_force_n(results, "course_after")


def _rms_force_n(results: Sequence[RecordingResult], course: str) -> float:
    errors = [
        course_pa(result, getattr(result.figures, course))[result.figures.known] * result.seen.usable.sum()
        * result.seen.layout.taxel_area_m2
        for result in results
    ]  # fmt: skip
    return float(np.sqrt(np.mean(np.square(np.concatenate(errors)))))
