"""Detect times in which the readings of triangles scatter more than usual."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter, uniform_filter1d

from ...physics.law import Array
from ..finding import Finding
from ..places import place_of_triangles
from .fault_finding import make_fault_finding
from .grid_readings import LEAST_ROWS
from .interpolated_noise import noise_of_rows
from .wrench import WrenchObservation

BURST_RATIO, CALM_QUANTILE = 2.0, 0.25  # a window's noise against the triangle's usual one; rows in the air
CALM_SHARE, LEAST_CALM_ROWS = 0.35, 4  # rows in which the load changes least, of all; smallest number in a window
USUAL_WINDOW_QUANTILE = 0.3  # of the windows: noise that is present half of the time is usual
LEAST_NOISE_COUNT = 0.5  # of a reading that toggles between two counts by rounding alone
WINDOW_S, LEAST_BURST_S, MOST_BURST = 1.5, 2.9, 0.75
LEAST_KEPT = 0.2  # of the noise of readings, in the rows of a window: less is in a gap
LEAST_TIMES, UNDER_LOAD = 4, 0.9  # bursts; share of pairs of a noisy and a quiet window in which the former bears more
MOST_CUT_OFF = 0.5  # of a window's readings at an end of their range
AROUND_S, MOST_CUT_OFF_AROUND = 0.3, 0.02  # readings about a row; share at an end beyond which the others are biased


def detect_noise_bursts(seen: WrenchObservation) -> tuple[Array, list[Finding]]:
    """Return the noise of each triangle's readings as a multiple of its usual noise, (N, T), and a finding on bursts.

    Noise is the RMS of third differences, which contain hardly any load, in windows of WINDOW_S. Rows between readings
    have less of it, by interpolation, and a row may come nearer to a reading in some windows than in others.
    """
    noise_ratio = np.ones(seen.missing.shape)
    window_rows = max(round(WINDOW_S / seen.step_s), 8)
    n_windows = len(seen.t_s) // window_rows
    if n_windows < 8:
        return noise_ratio, []
    third_difference = np.zeros_like(seen.activation_count)
    third_difference[1:-2] = np.diff(seen.activation_count, n=3, axis=0) / np.sqrt(20.0)
    taxels = np.maximum(seen.usable.sum(axis=1), 1)
    rms_difference = np.sqrt(np.sum(third_difference**2 * seen.usable, axis=2) / taxels)
    is_calm = _calm_rows(seen, third_difference, n_windows, window_rows)
    kept = _kept_noise(seen, n_windows, window_rows)
    noise_level = _calm_level(rms_difference, is_calm) / kept
    late_level = _calm_level(_change_in_half_a_period(seen), is_calm) / kept
    # Readings at an end of the range have no noise, so the usual noise would pass for a burst beside them.
    is_cut_off = (seen.clipped | seen.missing)[: n_windows * window_rows].reshape(n_windows, window_rows, -1).mean(
        axis=1
    ) > MOST_CUT_OFF
    heard_level = np.where(is_cut_off, np.nan, noise_level)
    usual_level = np.where(is_cut_off.all(axis=0), np.inf, np.maximum(_usual_level(heard_level), LEAST_NOISE_COUNT))
    noise_level = np.where(is_cut_off, 0.0, noise_level)
    is_loud = noise_level > np.hypot(BURST_RATIO * usual_level, late_level)
    is_loud &= median_filter(is_loud.astype(np.uint8), (3, 1), mode="nearest") > 0
    share = is_loud.mean(axis=0)
    has_bursts = (share * n_windows * window_rows * seen.step_s >= LEAST_BURST_S) & (share < MOST_BURST)
    is_loud &= has_bursts
    window_ratio = np.where(is_loud, noise_level / usual_level, 1.0)
    weight_ratio = np.where(is_loud, window_ratio * _common_factor(seen, third_difference, is_calm, is_loud), 1.0)
    noise_ratio[: n_windows * window_rows] = np.repeat(weight_ratio, window_rows, axis=0)
    # A burst may begin and end within a window, so its neighbours count as noisy, too.
    noise_ratio = maximum_filter1d(noise_ratio, 2 * (window_rows // 2) + 1, axis=0)
    if not has_bursts.any():
        return noise_ratio, []
    edges = np.flatnonzero(np.diff(is_loud.any(axis=1).astype(int), prepend=0, append=0)).reshape(-1, 2)
    when = [
        (float(seen.t_s[a * window_rows]), float(seen.t_s[min(b * window_rows, len(seen.t_s) - 1)])) for a, b in edges
    ]
    word, in_words = "noise_burst", "for a while"
    if len(when) >= LEAST_TIMES and _is_under_load(seen, is_loud, has_bursts, window_rows):
        word, in_words = "unknown", "whenever the load is high"
    text = f"readings scatter {np.median(window_ratio[is_loud]):.1f} times as much as usual {in_words}"
    where = place_of_triangles(np.flatnonzero(has_bursts).tolist(), seen.layout)
    return noise_ratio, [make_fault_finding(seen, word, where, when, text)]


def biased_in_bursts(seen: WrenchObservation, noise_ratio: Array) -> NDArray[np.bool_]:
    """Return the rows (N, T) in which the readings of a triangle with bursts are near an end of their range.

    The noise is cut off at one side, so their mean is biased, for which no variance allows. Where most of it is cut off
    a burst is not detected, so these are not only rows of bursts. `noise_ratio`: as of `detect_noise_bursts`.
    """
    share = seen.cut_off.sum(axis=2) / np.maximum(seen.usable.sum(axis=1), 1)
    around = uniform_filter1d(share, 2 * round(0.5 * AROUND_S / seen.step_s) + 1, axis=0)
    return np.asarray((noise_ratio > 1.0).any(axis=0) & (around > MOST_CUT_OFF_AROUND))


def _is_under_load(
    seen: WrenchObservation, is_loud: NDArray[np.bool_], has_bursts: NDArray[np.bool_], window_rows: int
) -> bool:
    """Return whether a noisy window of triangles nearly always has a higher load than another one."""
    level = seen.activation_count[: len(is_loud) * window_rows, has_bursts][:, seen.usable[has_bursts]].mean(axis=1)
    of_window = level.reshape(-1, window_rows).mean(axis=1)
    is_any_loud = is_loud.any(axis=1)
    loud, quiet = of_window[is_any_loud], of_window[~is_any_loud]
    return bool(np.mean(loud[:, None] > quiet) > UNDER_LOAD)


def _common_factor(
    seen: WrenchObservation, third_difference: Array, is_calm: NDArray[np.bool_], is_loud: NDArray[np.bool_]
) -> Array:
    """Return how many times the noise of a board's mean in a burst is that of independent taxels, (T,), at least 1.

    Pick-up is common to the taxels of a board, so it does not average out in the wrench. 1 if the load of each triangle
    is known.
    """
    factor = np.ones(is_loud.shape[1])
    if seen.load_is_known:
        return factor
    n_windows, window_rows = is_calm.shape
    windows = third_difference[: is_calm.size].reshape(n_windows, window_rows, *seen.usable.shape)
    boards, has_bursts = seen.layout.identities[:, 0], is_loud.any(axis=0)
    for board in np.unique(boards[has_bursts]).tolist():
        of_board = (boards == board) & has_bursts
        is_burst = is_loud[:, of_board].any(axis=1)
        taxels = windows[is_burst][is_calm[is_burst]][:, of_board][:, seen.usable[of_board]]  # (m, k)
        if len(taxels):
            independent = float(np.mean(taxels**2)) / taxels.shape[1]
            common = float(np.mean(taxels.mean(axis=1) ** 2))
            factor[of_board] = np.sqrt(max(common / max(independent, 1e-12), 1.0))
    return factor


def _kept_noise(seen: WrenchObservation, n_windows: int, window_rows: int) -> Array:
    """Return the share (n, T) of the readings' noise that the rows of n windows have."""
    kept = np.ones((n_windows, len(seen.readings)))
    for row, readings in enumerate(seen.readings):
        if len(readings.t_s) >= LEAST_ROWS:
            noise = noise_of_rows(readings.t_s.tobytes(), seen.t_s.tobytes())
            square = np.zeros(len(noise))
            square[1:-2] = np.mean(np.diff(noise, n=3, axis=0) ** 2, axis=1) / 20.0
            kept[:, row] = np.sqrt(square[: n_windows * window_rows].reshape(n_windows, window_rows).mean(axis=1))
    return np.maximum(kept, LEAST_KEPT)


def _change_in_half_a_period(seen: WrenchObservation) -> Array:
    """Return the change (N, T) of the readings in half of their period: what an error of their times looks like."""
    mean_count = np.sum(seen.activation_count * seen.usable, axis=2) / np.maximum(seen.usable.sum(axis=1), 1)
    change = np.zeros_like(mean_count)
    change[2:-2] = np.abs(mean_count[4:] - mean_count[:-4]) / (4.0 * seen.step_s)
    period_s = np.where(np.isfinite(seen.period_s), seen.period_s, seen.step_s)
    return np.asarray(0.5 * period_s * change)


def _calm_rows(seen: WrenchObservation, third_difference: Array, n_windows: int, window_rows: int) -> NDArray[np.bool_]:
    """Return the rows (n, m) of windows in which the load is calm: most triangles hardly change."""
    taxels = np.maximum(seen.usable.sum(axis=1), 1)
    median_change = np.median(np.abs(np.sum(third_difference * seen.usable, axis=2)) / taxels, axis=1)
    is_calm = median_change <= np.quantile(median_change, CALM_SHARE)
    return np.asarray(is_calm[: n_windows * window_rows].reshape(n_windows, window_rows))


def _calm_level(course: Array, is_calm: NDArray[np.bool_]) -> Array:
    """Return the level (n, T) of `course` (N, T) in n windows, from the rows that are calm (n, m).

    In a window with few such rows a low quantile of all rows is used: an edge of the load takes a few rows, a burst all
    of them.
    """
    windows = course[: is_calm.size].reshape(*is_calm.shape, -1)
    level = np.quantile(windows, CALM_QUANTILE, axis=1)
    for k in np.flatnonzero(is_calm.sum(axis=1) >= LEAST_CALM_ROWS):
        level[k] = np.median(windows[k, is_calm[k]], axis=0)
    return np.asarray(level)


def _usual_level(values: Array) -> Array:
    """Return a low quantile (m,) of each column of (n, m), without NaN; 0 for a column of NaN."""
    is_finite = np.isfinite(values)
    return np.array(
        [
            np.quantile(column[finite], USUAL_WINDOW_QUANTILE) if finite.any() else 0.0
            for column, finite in zip(values.T, is_finite.T, strict=True)
        ]
    )
