"""The course that several series share, each with its own offset and sensitivity, and known in parts only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array

ROUNDS = 30  # of fitting the course and the sensitivities in turn
CONVERGED = 1e-3  # largest change of the course in a round, relative to its range
ROUGHNESS = 1e-3  # weight of the squared second difference of the course, relative to that of the series
LEAST_KNOWN = 4  # samples of a series that is used
LEAST_KNOWN_SHARE = 0.5  # of the course
HALVES = slice(0, None, 2), slice(1, None, 2)  # of the series


@dataclass(frozen=True, slots=True, eq=False)
class CommonCourse:
    """A course (m,) in units of the median sensitivity of its series, and the estimates (m, p) of it by each."""

    course: Array
    by_series: Array
    information: Array  # (m, p) inverse variances of these estimates; 0 where a series is not known

    @property
    def agreement(self) -> float:
        """Correlation of the estimates by one half of the series with those by the other, by what both know."""
        halves = [(self.by_series[:, series], self.information[:, series]) for series in HALVES]
        (one, of_one), (other, of_other) = (
            (np.sum(values * information, axis=1), information.sum(axis=1)) for values, information in halves
        )
        both = (of_one > 0.0) & (of_other > 0.0)
        if np.count_nonzero(both) < LEAST_KNOWN:
            return 0.0
        one, other, of_one, of_other = one[both], other[both], of_one[both], of_other[both]
        covariance = np.cov(one / of_one, other / of_other, aweights=of_one * of_other / (of_one + of_other))
        variance = float(covariance[0, 0] * covariance[1, 1])
        return float(covariance[0, 1] / np.sqrt(variance)) if variance > 0.0 else 0.0


def common_course(
    values: Array, known: NDArray[np.bool_], segment: NDArray[np.intp], least_std: float
) -> CommonCourse | None:
    """Return the course that the series `values` (m, p) share, by fitting it and their sensitivities in turn.

    values[k, i] = offset[segment[k, i], i] + sensitivity_i · course[k] + noise, where `known` (m, p). `least_std`: of
    the noise of a series, so that none determines the course alone. Where no series is known, the course is as smooth
    as possible. None if less than half of it is known.
    """
    used = known.sum(axis=0) >= LEAST_KNOWN
    values, known, segment = values[:, used], known[:, used], segment[:, used]
    if known.any(axis=1).mean() < LEAST_KNOWN_SHARE:
        return None
    m, p = values.shape
    both = known[1:] & known[:-1] & (segment[1:] == segment[:-1])
    increments = [
        float(np.median(step[yes])) if yes.any() else 0.0
        for step, yes in zip(np.diff(values, axis=0), both, strict=True)
    ]
    course = np.concatenate([[0.0], np.cumsum(increments)])
    bend = np.diff(np.eye(m), 2, axis=0)
    by_series, information = np.zeros((m, p)), np.zeros((m, p))
    for _ in range(ROUNDS):
        offset, sensitivity = _lines(values, known, segment, course)
        scale = float(np.median(np.abs(sensitivity)))
        if scale <= 0.0:
            break
        sensitivity /= scale if np.median(sensitivity) >= 0.0 else -scale
        residual = np.where(known, values - offset - sensitivity * (course * scale)[:, None], 0.0)
        variance = np.sum(residual**2, axis=0) / np.maximum(known.sum(axis=0) - 2, 1) + least_std**2
        information = known * sensitivity**2 / variance
        by_series = (values - offset) / np.where(sensitivity == 0.0, 1.0, sensitivity)
        of_sample = information.sum(axis=1)
        normal = np.diag(of_sample) + ROUGHNESS * float(of_sample.mean()) * bend.T @ bend
        again = np.linalg.solve(normal, np.sum(information * by_series, axis=1))
        is_same = np.ptp(again - course) < CONVERGED * np.ptp(again)
        course = again
        if is_same:
            break
    return CommonCourse(course - np.median(course), by_series - np.median(course), information)


def _lines(values: Array, known: NDArray[np.bool_], segment: NDArray[np.intp], course: Array) -> tuple[Array, Array]:
    """Return offsets (m, p) and sensitivities (p,) of all series, by least squares."""
    offset, sensitivity = np.zeros(values.shape), np.zeros(values.shape[1])
    for i in range(values.shape[1]):
        rows = np.flatnonzero(known[:, i])
        indicator = segment[:, i, None] == np.unique(segment[rows, i])
        columns = np.concatenate([indicator, course[:, None]], axis=1)
        fitted = np.linalg.lstsq(columns[rows], values[rows, i], rcond=None)[0]
        offset[:, i], sensitivity[i] = indicator @ fitted[:-1], fitted[-1]
    return offset, sensitivity
