"""Readings of every triangle at the times they were taken, straight from the frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, interp1d
from scipy.ndimage import median_filter, uniform_filter1d

from ...bus.candump import CandumpReader
from ...physics.law import Array
from ...recording.loading import FootRecording, Recording, as_configured
from ...skin.geometry import N_TAXELS, PRESSURE_TAXELS
from ...skin.streams import Streams
from ...skin.validity import Validity
from .outliers import interpolated, outliers

WORKS = 0.02  # of its readings, that are valid where a taxel works at all
MOST_COUNT = 255
BUSY_READINGS = 5  # around one that moves the load, over which chance is told
LEAST_READINGS = 4  # of a triangle: fewer make no curve in time
LEAST_STEP_S = 1e-3  # two readings of a triangle are further apart
GAP_PERIODS = 1.6  # a longer pause between two readings is a gap
JITTER_READINGS = 51  # of the window in which a board's clock is taken as regular
MOST_JITTER = 0.15  # median, of a period: a board that does not keep its period is believed stamp by stamp
WAIT_JITTER = 0.35  # median, of a period of the board: how long conversions of a regular converter wait for it
LEAST_SLOWER = 1.1  # periods of the board: what repeats at the board's own pace are frames, not conversions
HELD_ODDS = 3.0  # identical readings this many times more frequent than chance: the converter repeats old values
HELD_LEAST = 0.02
FROZEN_ODDS = 1e-6  # of a stretch of identical readings in a whole recording, by chance
FROZEN_LEAST = 8  # readings of such a stretch
FROZEN_ROOM = 0.5  # of the taxels, that are valid and not at the end of their range
SAME_LEVEL_COUNT = 2.0  # readings that differ by no more on the average are as likely to stay the same
MOVES_COUNT = 3.0  # by which half of all triangles move meanwhile

Raw: TypeAlias = tuple[Array, NDArray[np.uint8], NDArray[np.uint16]]  # times (k,), counts (k, 12), status words (k,)


@dataclass(frozen=True, slots=True, eq=False)
class TriangleReadings:
    """k new readings of one triangle, in time order."""

    t_s: Array  # (k,) when they were taken, since the recording's first cycle
    counts: Array  # (k, 12)
    valid: NDArray[np.bool_]  # (k, 12)
    period_s: float  # between two readings; inf: there are none
    held_fraction: float = 0.0  # of all readings that came: repeats of an old conversion, left out here
    is_converter_slow: bool = False  # these repeats come regularly, from a converter that has a period of its own
    latest_s: float = 0.0  # by which all may have been taken earlier, where a host's rows are all that was kept
    is_outlier: NDArray[np.bool_] | None = None  # (k, 12) readings that are wrong, and interpolated in `counts`

    @property
    def as_read(self) -> NDArray[np.bool_]:
        """(k, 12) valid readings that are not interpolated."""
        return self.valid if self.is_outlier is None else self.valid & ~self.is_outlier

    def at(self, grid_s: Array) -> Array:
        """Counts (N, 12) at the times `grid_s` (N,), by a cubic through the valid readings of a taxel; NaN: none.

        Through a pause goes a straight line.
        """
        found = np.full((len(grid_s), N_TAXELS), np.nan)
        if len(self.t_s) < LEAST_READINGS:
            return found
        at_s = np.clip(grid_s, self.t_s[0], self.t_s[-1])
        whole = self.valid.all(axis=0)
        if whole.any():
            found[:, whole] = CubicSpline(self.t_s, self.counts[:, whole])(at_s)
            paused = self.in_gap(grid_s)
            if paused.any():
                straight = interp1d(self.t_s, self.counts[:, whole], axis=0)(at_s[paused])
                found[np.ix_(paused, whole)] = straight
        for taxel in np.flatnonzero(~whole):
            good = self.valid[:, taxel]
            if good.sum() >= LEAST_READINGS:
                found[:, taxel] = np.interp(at_s, self.t_s[good], self.counts[good, taxel])
        return found

    def is_refused(self, grid_s: Array) -> NDArray[np.bool_]:
        """(N, 12) where the readings beside the times `grid_s` (N,) are not valid, of taxels that work."""
        if len(self.t_s) < LEAST_READINGS:
            return np.zeros((len(grid_s), N_TAXELS), bool)
        after = np.searchsorted(self.t_s, grid_s).clip(1, len(self.t_s) - 1)
        works = self.valid.mean(axis=0) > WORKS
        return np.asarray(works & ~(self.valid[after] & self.valid[after - 1]))

    def in_gap(self, grid_s: Array, least_s: float = 0.0) -> NDArray[np.bool_]:
        """Which of the times `grid_s` (N,) lie in a pause without readings, of at least `least_s`."""
        if len(self.t_s) < LEAST_READINGS:
            return np.ones(len(grid_s), bool)
        after = np.searchsorted(self.t_s, grid_s).clip(1, len(self.t_s) - 1)
        pause_s = self.t_s[after] - self.t_s[after - 1]
        outside = (grid_s < self.t_s[0] - self.period_s) | (grid_s > self.t_s[-1] + self.period_s)
        return np.asarray((pause_s > max(GAP_PERIODS * self.period_s, least_s)) | outside)


def read_triangles(recording: Recording, foot: FootRecording) -> list[TriangleReadings]:
    """New readings of every triangle of `foot`, in the layout's order; a triangle that never sent has none."""
    raw = _from_frames(recording, foot) if recording.log is not None else _from_cycles(foot)
    # Rows of a host without ages: a reading came at any moment since the row before.
    row_s = 0.0 if recording.log is not None or foot.age_ns.any() else float(np.median(np.diff(foot.t_ns))) * 1e-9
    longest = max(len(t_s) for t_s, _, _ in raw)
    counts = np.zeros((longest, len(raw), N_TAXELS), np.uint8)
    status = np.zeros((longest, len(raw)), np.uint16)
    for row, (t_s, own, words) in enumerate(raw):
        counts[: len(t_s), row], status[: len(t_s), row] = own, words
    settings = {board.address: as_configured(board) for board in foot.boards}
    valid = Validity(foot.layout, settings, 1)(counts, status, np.zeros(status.shape, np.int64))
    if foot.calibration is not None:
        usable = foot.calibration.usable
        valid &= usable | ~usable.any(axis=1, keepdims=True)  # what nobody calibrated may be told by others' curves
    found = []
    for row, (t_s, own, _) in enumerate(raw):
        k = len(t_s)
        if k < LEAST_READINGS:
            found.append(TriangleReadings(np.empty(0), np.empty((0, N_TAXELS)), np.empty((0, N_TAXELS), bool), np.inf))
            continue
        period_s = float(np.median(np.diff(t_s)))
        regular_s, jitter_s = _regular(t_s, period_s)
        times_s = regular_s if jitter_s < MOST_JITTER * period_s else t_s
        found.append(TriangleReadings(times_s, own.astype(np.float64), valid[:k, row], period_s, latest_s=row_s))
    return [_without_outliers(_without_held(each)) for each in _without_frozen(found)]


def _from_frames(recording: Recording, foot: FootRecording) -> list[Raw]:
    """Per triangle the times (k,), counts (k, 12) and status words (k,) of readings of which both halves came."""
    assert recording.log is not None
    streams = Streams([foot.layout])
    slots, data, t_ns = [], [], []
    with CandumpReader(recording.log) as reader:
        for batch in reader.pieces():
            slot = streams.slots(batch)
            own = slot >= 0
            slots.append(slot[own])
            data.append(batch.data[own])
            t_ns.append(batch.t_ns[own])
    slot, payload = np.concatenate(slots), np.concatenate(data)
    t_s = (np.concatenate(t_ns) - foot.t_ns[0]) * 1e-9
    order = np.lexsort((t_s, slot))  # a log that was put together may not be in time order
    starts = np.searchsorted(slot[order], np.arange(2 * len(foot.layout) + 1))
    found = []
    for row in range(len(foot.layout)):
        a, b = (order[starts[2 * row + half] : starts[2 * row + half + 1]] for half in (0, 1))
        found.append(_paired(t_s[a], payload[a], t_s[b], payload[b]))
    return found


def _paired(
    a_s: Array, a: NDArray[np.uint8], b_s: Array, b: NDArray[np.uint8]
) -> tuple[Array, NDArray[np.uint8], NDArray[np.uint16]]:
    """Halves A and B that belong together: those nearest in time, within half a period."""
    if not len(a_s) or len(b_s) < 2:
        return np.empty(0), np.empty((0, N_TAXELS), np.uint8), np.empty(0, np.uint16)
    after = np.searchsorted(b_s, a_s).clip(1, len(b_s) - 1)
    near = np.where(np.abs(b_s[after] - a_s) < np.abs(b_s[after - 1] - a_s), after, after - 1)
    most_s = 0.5 * float(np.median(np.diff(b_s)))
    good = np.abs(b_s[near] - a_s) < most_s
    near, a_s, a = near[good], a_s[good], a[good]
    t_s = np.minimum(a_s, b_s[near])
    new = np.diff(t_s, prepend=-np.inf) > LEAST_STEP_S
    other = b[near]
    counts = np.concatenate([a[:, 1:8], other[:, 1:6]], axis=1)
    status = (other[:, 6].astype(np.uint16) << 8 | other[:, 7]).astype(np.uint16)
    return t_s[new], counts[new], status[new]


def _from_cycles(foot: FootRecording) -> list[Raw]:
    """The same where no frames were kept: cycles in which the triangle's reading was not older than the last cycle."""
    t_s = (foot.t_ns - foot.t_ns[0]) * 1e-9
    found = []
    for row in range(len(foot.layout)):
        taken_s = t_s - np.maximum(foot.age_ns[:, row], 0) * 1e-9
        new = (np.diff(np.maximum.accumulate(taken_s), prepend=-np.inf) > LEAST_STEP_S) & ~foot.missing[:, row]
        new &= ~foot.repeated & (foot.age_ns[:, row] >= 0)
        found.append((taken_s[new], foot.counts[new, row], foot.status[new, row]))
    return found


def _regular(t_s: Array, period_s: float) -> tuple[Array, float]:
    """Times (k,) without the jitter of their stamps, and the median of that jitter.

    A board reads by a crystal, a stamp comes when a host looks; a converter is regular, and its board is late.
    """
    number = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(np.diff(t_s) / period_s), 1.0))])
    late_s = t_s - number * period_s
    window = min(JITTER_READINGS, len(t_s))
    smooth = uniform_filter1d(median_filter(late_s, 3, mode="nearest"), window, mode="nearest")
    regular = number * period_s + smooth
    jitter_s = float(np.median(np.abs(late_s - smooth)))
    return regular, jitter_s if bool(np.all(np.diff(regular) > 0)) else np.inf


def _without_frozen(every: Sequence[TriangleReadings]) -> list[TriangleReadings]:
    """Readings without stretches in which all of a triangle stays the same while the rest of the insole moves.

    A triangle in the air may stay the same for long, too: how often it does so at the same level elsewhere is its
    chance.
    """
    level = [each.counts[:, PRESSURE_TAXELS].mean(axis=1) for each in every]
    found = []
    for row, own in enumerate(every):
        if len(own.t_s) < LEAST_READINGS:
            found.append(own)
            continue
        kept = np.ones(len(own.t_s), bool)
        same = np.concatenate([[False], np.all(np.diff(own.counts[:, PRESSURE_TAXELS], axis=0) == 0, axis=1)])
        for a, b in np.flatnonzero(np.diff(same, prepend=False, append=False)).reshape(-1, 2).tolist():
            room = own.valid[a] & (own.counts[a] > 0) & (own.counts[a] < MOST_COUNT)
            if b - a < FROZEN_LEAST or np.mean(room[PRESSURE_TAXELS]) < FROZEN_ROOM:
                continue  # an open contact reads the ends of the range
            alike = np.abs(level[row] - level[row][a]) < SAME_LEVEL_COUNT
            alike[a:b] = False
            chance = (np.count_nonzero(same[alike]) + 1) / (np.count_nonzero(alike) + 2)
            if len(same) * chance ** (b - a) < FROZEN_ODDS and _moves(every, level, row, own.t_s[a], own.t_s[b - 1]):
                kept[a:b] = False
        if kept.all() or kept.sum() < LEAST_READINGS:
            found.append(own)
            continue
        found.append(
            replace(
                own, t_s=own.t_s[kept], counts=own.counts[kept], valid=own.valid[kept],
                held_fraction=float(np.mean(~kept)),
            )
        )  # fmt: skip
    return found


def _without_outliers(readings: TriangleReadings) -> TriangleReadings:
    """Readings with what single taxels cannot have read interpolated."""
    wrong = outliers(readings.t_s, readings.counts, readings.valid)
    if not wrong.any():
        return readings
    return replace(
        readings, counts=interpolated(readings.t_s, readings.counts, readings.valid & ~wrong, wrong), is_outlier=wrong
    )


def _moves(every: Sequence[TriangleReadings], level: Sequence[Array], row: int, from_s: float, to_s: float) -> bool:
    """Whether half of the triangles other than `row` move between two moments."""
    spans = [
        float(np.ptp(course[during]))
        for other, (each, course) in enumerate(zip(every, level, strict=True))
        if other != row and (during := (each.t_s >= from_s) & (each.t_s <= to_s)).any()
    ]
    return bool(spans) and float(np.median(spans)) > MOVES_COUNT


def _without_held(readings: TriangleReadings) -> TriangleReadings:
    """Readings without those that repeat the conversion before them, at the times of the conversions.

    A converter is regular by itself, and its values wait until the board sends. How long is told as far as waits
    differ: where the pace of the converter is a multiple of the board's they are all the same, and all readings may
    have been taken earlier by up to the board's period. Where new values are not regular, frames were repeated, and
    the times are those of the board.

    Taxels that are noisy by themselves stay the same together only where the converter had nothing new: what happens
    more often than their own rates allow is taken for held.
    """
    if len(readings.t_s) < BUSY_READINGS:
        return readings
    pressure = readings.counts[:, PRESSURE_TAXELS]
    same = np.zeros(pressure.shape, bool)
    # Readings at the end of their range are the same because there is no more room.
    same[1:] = (pressure[1:] == pressure[:-1]) & (pressure[1:] > 0) & (pressure[1:] < MOST_COUNT)
    lively = same.mean(axis=0) < 0.95
    if lively.sum() < 3:
        return readings
    together = np.asarray(same[:, lively].all(axis=1))
    moving = ~together
    # Chance is told where the load moves: at rest all of a quiet triangle may stay the same.
    busy = np.zeros(len(same), bool)
    busy[1:] = np.abs(np.diff(pressure[:, lively].mean(axis=1))) > 1.0
    window = np.convolve(busy, np.ones(BUSY_READINGS), "same") > 0
    if window.sum() < 50:
        window[:] = True
    by_chance = float(np.prod(same[moving & window][:, lively].mean(axis=0))) if (moving & window).sum() > 10 else 1.0
    if together[window].mean() <= HELD_ODDS * by_chance + HELD_LEAST:
        return readings
    kept = ~together
    if kept.sum() < LEAST_READINGS:
        return readings
    t_s = readings.t_s[kept]
    steps_s = np.diff(t_s)
    period_s = float(steps_s[steps_s < 2.5 * np.median(steps_s)].mean())
    regular_s, jitter_s = _regular(t_s, period_s)
    found = replace(
        readings, t_s=t_s, counts=readings.counts[kept], valid=readings.valid[kept],
        held_fraction=readings.held_fraction + float(together.mean()),
    )  # fmt: skip
    step_s = float(np.median(np.diff(regular_s)))
    if jitter_s > WAIT_JITTER * readings.period_s or step_s < LEAST_SLOWER * readings.period_s:
        return found
    # Waits that are spread evenly are on the median a quarter of the longest away from their mean.
    spread_s = min(4.0 * jitter_s, readings.period_s)
    return replace(
        found, t_s=regular_s - spread_s / 2, period_s=step_s, is_converter_slow=True,
        latest_s=readings.latest_s + readings.period_s - spread_s,
    )  # fmt: skip
