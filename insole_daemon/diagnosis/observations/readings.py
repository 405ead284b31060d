"""Read the counts of every triangle at the times they were taken, from the frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, interp1d
from scipy.ndimage import median_filter, uniform_filter1d

from ...bus.candump import CandumpReader
from ...physics.digitiser import count_of
from ...physics.law import Array
from ...recording.document import RecordedBoard
from ...recording.loading import FootRecording, Recording, as_configured
from ...skin.geometry import N_TAXELS, PRESSURE_TAXELS
from ...skin.streams import Streams
from ...skin.validity import Validity
from .bus_waits import bus_waits
from .outliers import interpolated, outliers

LEAST_VALID = 0.02  # share of a working taxel's readings that are valid
MOST_COUNT = 255
CHANGE_READINGS = 5  # around a change of the load, in which the probability of equal readings is estimated
LEAST_READINGS = 4  # of a triangle for an interpolation
LEAST_STEP_S = 1e-3  # between two readings of a triangle
GAP_PERIODS = 1.6  # a longer pause between two readings is a gap
JITTER_READINGS = 51  # of the window in which a board's clock is taken as regular
LEAST_PROMPT = 0.1  # share of readings that did not wait: with fewer, they do not determine the times of the others
MOST_JITTER = 0.15  # median, as share of the period: beyond it time stamps are used as they are
WAIT_JITTER = 0.35  # median, as share of the board's period, that conversions of a slower converter wait at most
LEAST_PERIOD_RATIO = 1.1  # of converter to board: below it frames are repeated, not conversions
REPEAT_RATIO = 3.0  # of identical readings to those by chance: the converter repeats old values
LEAST_REPEATED = 0.02  # share of readings
FEWEST_REPEATED = 6  # readings while the load changes: fewer may be equal by chance
LEAST_NOISY = 3  # taxels of a triangle whose equal readings tell a repeat
FROZEN_ODDS = 1e-6  # expected number of such stretches by chance in a whole recording
MOST_REPEATS = 0.5  # usual share of repeats, from which the length of a stretch says nothing
FROZEN_READINGS = 8  # shortest stretch of identical readings
LEAST_IN_RANGE = 0.5  # of the taxels, valid and not at an end of their range
SIMILAR_COUNT = 2.0  # difference of mean readings below which their probability to repeat is the same

# Times (k,), counts (k, 12), status words (k,), and how long readings can have waited for the bus (k,).
Raw: TypeAlias = tuple[Array, NDArray[np.uint8], NDArray[np.uint16], Array]


@dataclass(frozen=True, slots=True, eq=False)
class TriangleReadings:
    """k new readings of one triangle, in time order."""

    t_s: Array  # (k,) when they were taken, since the recording's first cycle
    counts: Array  # (k, 12)
    valid: NDArray[np.bool_]  # (k, 12)
    period_s: float  # between two readings; inf without readings
    held_fraction: float = 0.0  # of all readings that came: repeats of an old conversion, which are left out
    is_converter_slow: bool = False  # repeats are regular: the converter has a longer period than the board
    latest_s: float = 0.0  # by which all readings may have been taken earlier
    waited_s: float = 0.0  # by which they may have been, with all of their board, because the bus was busy
    zero_count: float | None = None  # mean count of the digitiser's value 0; None if the board's settings are unknown
    is_outlier: NDArray[np.bool_] | None = None  # (k, 12) outliers, interpolated in `counts`

    @property
    def as_read(self) -> NDArray[np.bool_]:
        """Return which readings (k, 12) are valid and not interpolated."""
        return self.valid if self.is_outlier is None else self.valid & ~self.is_outlier

    def at(self, grid_s: Array) -> Array:
        """Return the counts (N, 12) at times `grid_s` (N,), by a cubic through the valid readings of each taxel.

        In gaps, and for taxels with invalid readings, the interpolation is linear. NaN for a taxel without valid
        readings.
        """
        counts = np.full((len(grid_s), N_TAXELS), np.nan)
        if len(self.t_s) < LEAST_READINGS:
            return counts
        at_s = np.clip(grid_s, self.t_s[0], self.t_s[-1])
        always_valid = self.valid.all(axis=0)
        if always_valid.any():
            counts[:, always_valid] = CubicSpline(self.t_s, self.counts[:, always_valid])(at_s)
            is_gap = self.in_gap(grid_s)
            if is_gap.any():
                linear = interp1d(self.t_s, self.counts[:, always_valid], axis=0)(at_s[is_gap])
                counts[np.ix_(is_gap, always_valid)] = linear
        for taxel in np.flatnonzero(~always_valid):
            is_valid = self.valid[:, taxel]
            if is_valid.sum() >= LEAST_READINGS:
                counts[:, taxel] = np.interp(at_s, self.t_s[is_valid], self.counts[is_valid, taxel])
        return counts

    def is_invalid_near(self, grid_s: Array) -> NDArray[np.bool_]:
        """Return where the readings around the times `grid_s` (N,) are not valid, for taxels that work, (N, 12)."""
        if len(self.t_s) < LEAST_READINGS:
            return np.zeros((len(grid_s), N_TAXELS), bool)
        after = np.searchsorted(self.t_s, grid_s).clip(1, len(self.t_s) - 1)
        works = self.valid.mean(axis=0) > LEAST_VALID
        return np.asarray(works & ~(self.valid[after] & self.valid[after - 1]))

    def in_gap(self, grid_s: Array, least_s: float = 0.0) -> NDArray[np.bool_]:
        """Return which of the times `grid_s` (N,) are in a gap of at least `least_s` between readings, (N,)."""
        if len(self.t_s) < LEAST_READINGS:
            return np.ones(len(grid_s), bool)
        after = np.searchsorted(self.t_s, grid_s).clip(1, len(self.t_s) - 1)
        pause_s = self.t_s[after] - self.t_s[after - 1]
        outside = (grid_s < self.t_s[0] - self.period_s) | (grid_s > self.t_s[-1] + self.period_s)
        return np.asarray((pause_s > max(GAP_PERIODS * self.period_s, least_s)) | outside)


def read_triangles(recording: Recording, foot: FootRecording) -> list[TriangleReadings]:
    """Return the new readings of every triangle of `foot`, in the layout's order; a triangle may have none."""
    raw = _from_frames(recording, foot) if recording.log is not None else _from_cycles(foot)
    # Without ages in the rows of a host, a reading came at any time since the row before.
    row_s = 0.0 if recording.log is not None or foot.age_ns.any() else float(np.median(np.diff(foot.t_ns))) * 1e-9
    most_readings = max(len(t_s) for t_s, *_ in raw)
    counts = np.zeros((most_readings, len(raw), N_TAXELS), np.uint8)
    status = np.zeros((most_readings, len(raw)), np.uint16)
    for row, (t_s, counts_of_triangle, status_words, _) in enumerate(raw):
        counts[: len(t_s), row], status[: len(t_s), row] = counts_of_triangle, status_words
    settings = {board.address: as_configured(board) for board in foot.boards}
    valid = Validity(foot.layout, settings, 1)(counts, status, np.zeros(status.shape, np.int64))
    if foot.calibration is not None:
        usable = foot.calibration.usable
        valid &= usable | ~usable.any(axis=1, keepdims=True)  # an uncalibrated triangle may use the curves of others
    zero_counts = {board.address: _zero_count(board) for board in foot.boards}
    triangles = []
    for row, (t_s, counts_of_triangle, _, waits_s) in enumerate(raw):
        n = len(t_s)
        if n < LEAST_READINGS:
            triangles.append(
                TriangleReadings(np.empty(0), np.empty((0, N_TAXELS)), np.empty((0, N_TAXELS), bool), np.inf)
            )
            continue
        period_s = float(np.median(np.diff(t_s)))
        is_prompt = waits_s <= 0.0
        is_known = bool(is_prompt.mean() >= LEAST_PROMPT)
        regular_s, jitter_s = _without_jitter(t_s, period_s, is_prompt if is_known else None)
        times_s = regular_s if jitter_s < MOST_JITTER * period_s else t_s
        triangles.append(
            TriangleReadings(
                times_s, counts_of_triangle.astype(np.float64), valid[:n, row], period_s, latest_s=row_s,
                waited_s=0.0 if is_known else float(np.median(waits_s)),
                zero_count=zero_counts.get(int(foot.layout.identities[row, 0])),
            )
        )  # fmt: skip
    return [_without_outliers(_without_repeats(readings)) for readings in _without_frozen(triangles)]


def _zero_count(board: RecordedBoard) -> float | None:
    """Return the mean count of the digitiser's value 0; None if the board's settings are unknown."""
    if board.no_load is None or board.shift is None:
        return None
    return float(count_of(np.zeros(1), np.array([board.no_load]), np.array([board.shift]))[0])


def _from_frames(recording: Recording, foot: FootRecording) -> list[Raw]:
    """Return the readings of each triangle of which both halves came."""
    assert recording.log is not None
    streams = Streams([foot.layout])
    slots, data, times_ns, interfaces = [], [], [], []
    with CandumpReader(recording.log) as reader:
        for batch in reader.pieces():
            slots.append(streams.slots(batch))
            data.append(batch.data[slots[-1] >= 0])
            times_ns.append(batch.t_ns)
            interfaces.append(batch.interface)
    slot, payload, interface = np.concatenate(slots), np.concatenate(data), np.concatenate(interfaces)
    t_s = (np.concatenate(times_ns) - foot.t_ns[0]) * 1e-9
    boards = foot.layout.identities[:, 0]
    before_s, sent_s = np.zeros(len(t_s)), t_s.copy()
    for board in np.unique(boards):
        rows = np.flatnonzero(boards == board)
        waits = bus_waits(t_s, interface, np.isin(slot // 2, rows), slot == 2 * rows[0])
        sent_s -= waits[0]
        before_s += waits[1]
    t_s, before_s, slot = sent_s[slot >= 0], before_s[slot >= 0], slot[slot >= 0]
    order = np.lexsort((t_s, slot))  # a log that was joined from several may not be in time order
    starts = np.searchsorted(slot[order], np.arange(2 * len(foot.layout) + 1))
    raw = []
    for row in range(len(foot.layout)):
        half_a, half_b = (order[starts[2 * row + half] : starts[2 * row + half + 1]] for half in (0, 1))
        taken_s, counts, status = _join_halves(t_s[half_a], payload[half_a], t_s[half_b], payload[half_b])
        sent_in = np.maximum(np.searchsorted(t_s[half_a], taken_s, "right") - 1, 0)
        waits_s = before_s[half_a][sent_in]
        raw.append((taken_s, counts, status, waits_s))
    return raw


def _join_halves(
    a_s: Array, half_a: NDArray[np.uint8], b_s: Array, half_b: NDArray[np.uint8]
) -> tuple[Array, NDArray[np.uint8], NDArray[np.uint16]]:
    """Return times, counts and status words of readings, of the halves A and B that belong together.

    These are nearest in time, within half a period.
    """
    steps_s = np.diff(b_s)
    steps_s = steps_s[steps_s > LEAST_STEP_S]  # a frame may be in the log twice
    if not len(a_s) or not len(steps_s):
        return np.empty(0), np.empty((0, N_TAXELS), np.uint8), np.empty(0, np.uint16)
    after = np.searchsorted(b_s, a_s).clip(1, len(b_s) - 1)
    nearest = np.where(np.abs(b_s[after] - a_s) < np.abs(b_s[after - 1] - a_s), after, after - 1)
    most_s = 0.5 * float(np.median(steps_s))
    is_pair = np.abs(b_s[nearest] - a_s) < most_s
    nearest, a_s, half_a = nearest[is_pair], a_s[is_pair], half_a[is_pair]
    t_s = np.minimum(a_s, b_s[nearest])
    is_new = np.diff(t_s, prepend=-np.inf) > LEAST_STEP_S
    half_b_data = half_b[nearest]
    counts = np.concatenate([half_a[:, 1:8], half_b_data[:, 1:6]], axis=1)
    status = (half_b_data[:, 6].astype(np.uint16) << 8 | half_b_data[:, 7]).astype(np.uint16)
    return t_s[is_new], counts[is_new], status[is_new]


def _from_cycles(foot: FootRecording) -> list[Raw]:
    """Return the readings of a recording without frames: cycles whose reading is newer than that of the last cycle."""
    t_s = (foot.t_ns - foot.t_ns[0]) * 1e-9
    raw = []
    for row in range(len(foot.layout)):
        taken_s = t_s - np.maximum(foot.age_ns[:, row], 0) * 1e-9
        is_new = (np.diff(np.maximum.accumulate(taken_s), prepend=-np.inf) > LEAST_STEP_S) & ~foot.missing[:, row]
        is_new &= ~foot.repeated & (foot.age_ns[:, row] >= 0)
        waits_s = np.zeros(int(is_new.sum()))
        raw.append((taken_s[is_new], foot.counts[is_new, row], foot.status[is_new, row], waits_s))
    return raw


def _without_jitter(t_s: Array, period_s: float, is_prompt: NDArray[np.bool_] | None = None) -> tuple[Array, float]:
    """Return times (k,) without the jitter of their stamps, and the median of that jitter, s.

    A board or converter is regular by its crystal; stamps and transmission are late by varying times. `is_prompt` (k,):
    readings that did not wait for the bus, whose stamps tell the times of the others.
    """
    number = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(np.diff(t_s) / period_s), 1.0))])
    lateness_s = t_s - number * period_s
    if is_prompt is not None and not is_prompt.all():
        trend_s = number * np.polyfit(number[is_prompt], lateness_s[is_prompt], 1)[0]
        steady_s = (lateness_s - trend_s)[is_prompt]
        lateness_s = trend_s + np.interp(number, number[is_prompt], steady_s)
    window = min(JITTER_READINGS, len(t_s))
    smooth_s = uniform_filter1d(median_filter(lateness_s, 3, mode="nearest"), window, mode="nearest")
    regular_s = number * period_s + smooth_s
    jitter_s = float(np.median(np.abs(lateness_s - smooth_s)))
    return regular_s, jitter_s if bool(np.all(np.diff(regular_s) > 0)) else np.inf


def _without_frozen(triangles: Sequence[TriangleReadings]) -> list[TriangleReadings]:
    """Return readings without stretches in which a triangle stays the same while the rest of the insole changes.

    An unloaded triangle may stay the same for long, too. So a stretch must be improbable by two shares of repeats: that
    of its readings at a similar level, and that of other triangles at the same time, because in quiet standing all may.
    """
    mean_counts = [triangle.counts[:, PRESSURE_TAXELS].mean(axis=1) for triangle in triangles]
    repeats = [
        np.concatenate([[False], np.all(np.diff(triangle.counts[:, PRESSURE_TAXELS], axis=0) == 0, axis=1)])
        for triangle in triangles
    ]
    kept_triangles = []
    for row, readings in enumerate(triangles):
        if len(readings.t_s) < LEAST_READINGS:
            kept_triangles.append(readings)
            continue
        is_kept, is_repeat = np.ones(len(readings.t_s), bool), repeats[row]
        for a, b in np.flatnonzero(np.diff(is_repeat, prepend=False, append=False)).reshape(-1, 2).tolist():
            in_range = readings.valid[a] & (readings.counts[a] > 0) & (readings.counts[a] < MOST_COUNT)
            if b - a < FROZEN_READINGS or np.mean(in_range[PRESSURE_TAXELS]) < LEAST_IN_RANGE:
                continue  # an open contact reads the ends of the range
            is_similar = np.abs(mean_counts[row] - mean_counts[row][a]) < SIMILAR_COUNT
            is_similar[a:b] = False
            own = (np.count_nonzero(is_repeat[is_similar]) + 1) / (np.count_nonzero(is_similar) + 2)
            if _is_improbable(own, b - a, len(is_repeat)) and _is_improbable(
                _repeats_of_others(triangles, repeats, readings.t_s[a], readings.t_s[b - 1]), b - a, len(is_repeat)
            ):
                is_kept[a:b] = False
        if is_kept.all() or is_kept.sum() < LEAST_READINGS:
            kept_triangles.append(readings)
            continue
        kept_triangles.append(
            replace(
                readings, t_s=readings.t_s[is_kept], counts=readings.counts[is_kept], valid=readings.valid[is_kept],
                held_fraction=float(np.mean(~is_kept)),
            )
        )  # fmt: skip
    return kept_triangles


def _is_improbable(probability: float, length: int, n_readings: int) -> bool:
    """Return whether `length` repeats in a row of `n_readings` are no chance, if each has this `probability`.

    If it is MOST_REPEATS or more, the noise is so small that it depends on how near the level is to an edge of a count.
    """
    return probability < MOST_REPEATS and n_readings * probability**length < FROZEN_ODDS


def _repeats_of_others(
    triangles: Sequence[TriangleReadings], repeats: Sequence[NDArray[np.bool_]], from_s: float, to_s: float
) -> float:
    """Return the share of repeats between two times: the median of triangles that change at all, 1 if none does.

    Those that do not change may have the same fault: a board that repeats its frames does so with all its triangles.
    """
    shares = [
        float(np.mean(is_repeat[during]))
        for readings, is_repeat in zip(triangles, repeats, strict=True)
        if (during := (readings.t_s >= from_s) & (readings.t_s <= to_s)).any() and not is_repeat[during].all()
    ]
    return float(np.median(shares)) if shares else 1.0


def _without_outliers(readings: TriangleReadings) -> TriangleReadings:
    """Return readings with outliers of single taxels interpolated."""
    wrong = outliers(readings.t_s, readings.counts, readings.valid)
    if not wrong.any():
        return readings
    return replace(
        readings, counts=interpolated(readings.t_s, readings.counts, readings.valid & ~wrong, wrong), is_outlier=wrong
    )


def _without_repeats(readings: TriangleReadings) -> TriangleReadings:
    """Return readings without repeats of the conversion before, at the times of the conversions.

    Noisy taxels stay the same together only if the converter had no new value; more identical readings than their
    single probabilities allow are taken for repeats.

    A converter slower than its board is regular, and its values wait until the board sends. The waiting time is known
    as far as it varies: if the converter's period is a multiple of the board's, it is constant, and all readings may
    have been taken earlier by up to the board's period. If new values are not regular, frames were repeated, and the
    times are those of the board.
    """
    if len(readings.t_s) < CHANGE_READINGS:
        return readings
    pressure_counts = readings.counts[:, PRESSURE_TAXELS]
    is_same = np.zeros(pressure_counts.shape, bool)
    is_same[1:] = pressure_counts[1:] == pressure_counts[:-1]
    is_at_end = (pressure_counts == 0) | (pressure_counts >= MOST_COUNT)  # equal whatever the load
    is_equal = is_same & ~is_at_end
    is_noisy = is_equal.mean(axis=0) < 0.95
    if is_noisy.sum() < LEAST_NOISY:
        return readings
    is_unchanged = np.asarray(is_same[:, is_noisy].all(axis=1))
    all_equal = is_unchanged & (is_equal[:, is_noisy].sum(axis=1) >= LEAST_NOISY)
    is_new = ~all_equal
    # The probability of equal readings is estimated where the load changes: at rest a quiet triangle may not change.
    is_change = np.zeros(len(is_equal), bool)
    is_change[1:] = np.abs(np.diff(pressure_counts[:, is_noisy].mean(axis=1))) > 1.0
    near_change = np.convolve(is_change, np.ones(CHANGE_READINGS), "same") > 0
    if near_change.sum() < 50:
        near_change[:] = True
    chance = (
        float(np.prod(is_equal[is_new & near_change][:, is_noisy].mean(axis=0)))
        if (is_new & near_change).sum() > 10
        else 1.0
    )
    repeated = all_equal[near_change]
    if repeated.sum() < FEWEST_REPEATED or repeated.mean() <= REPEAT_RATIO * chance + LEAST_REPEATED:
        return readings
    is_kept = ~is_unchanged
    if is_kept.sum() < LEAST_READINGS:
        return readings
    t_s = readings.t_s[is_kept]
    steps_s = np.diff(t_s)
    period_s = float(steps_s[steps_s < 2.5 * np.median(steps_s)].mean())
    regular_s, jitter_s = _without_jitter(t_s, period_s)
    without_repeats = replace(
        readings, t_s=t_s, counts=readings.counts[is_kept], valid=readings.valid[is_kept],
        held_fraction=readings.held_fraction + float(is_unchanged.mean()),
    )  # fmt: skip
    step_s = float(np.median(np.diff(regular_s)))
    if jitter_s > WAIT_JITTER * readings.period_s or step_s < LEAST_PERIOD_RATIO * readings.period_s:
        return without_repeats
    # The median deviation of a uniform distribution is a quarter of its width.
    spread_s = min(4.0 * jitter_s, readings.period_s)
    return replace(
        without_repeats, t_s=regular_s - spread_s / 2, period_s=step_s, is_converter_slow=True,
        latest_s=readings.latest_s + readings.period_s - spread_s,
    )  # fmt: skip
