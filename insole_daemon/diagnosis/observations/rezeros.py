"""Detect boards that took new baselines under load, and correct their readings.

A re-zero sets the counts of all taxels to `no_load` from one reading to the next; later readings lack the load of that
moment.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...physics.effect import Where
from ...physics.effects import laws
from ...physics.law import Array
from ...recording.loading import FootRecording
from ..contact import stretches
from ..finding import Finding, Quantity
from ..places import place_in_words
from .paired import PairedObservation
from .wrench import WrenchObservation

LEAST_LOAD_COUNT = 5.0  # mean activation of a board at which a re-zero can be detected
LEAST_WALK_STEP_COUNT = 2.0  # the same on a walk, of the lowest readings
LANDING_COUNT = 2.5  # largest distance from `no_load` after a re-zero, beside three standard deviations of noise
MOST_ELSEWHERE = 0.1  # share of the taxels that are further from it
MOST_CUT_OFF = 0.3  # share of later readings at an end of their range: beyond it only the load's peaks are read
LEAST_DURATION_S = 3.0  # for which readings lack the load
BELOW_QUANTILE = 0.02  # of later readings, that is below no load if the load of a re-zero is removed
MISSING_RATIO = (0.5, 1.6)  # range of the median that later readings lack, over the size of the step
LEAST_ROWS = 50  # within range, to judge that
STEADY_QUANTILE, STEADY_RATIO = 0.1, 0.2  # low quantile of what later readings lack, over the size of the step
LESS_AS_PART = 0.5  # squared residual of a part of the load, over that of a constant
MOST_STEP_S = 0.12  # duration of the step, each way
STRETCH_S, LEAST_STRETCHES = 2.0, 3  # of a walk, with at least one swing; number of stretches before and after
PAUSE_S = 2.0  # before a fall of the readings, for a pause that may be that of the re-zero
STANCE_S = 2.0  # longest time from a re-zero under a walking foot until the foot is in the air
LEAST_WALK_S = 20.0  # of a walk before the re-zero, to leave out the rest
LOW_QUANTILE = 0.1  # of a stretch's rows, in which a foot that walks is in the air
AIR_QUANTILE = 0.25  # of the lowest readings of stretches: those with a swing
STANDING_RATIO = 0.3  # largest standard deviation of the readings of a standing person, over the size of the jump
JUMP_ROWS, CALM_RATIO = 2, 4.0  # of a landing: rows on each side, and its size over the changes before and after
MOST_BELOW = 0.1  # of the rows shortly before a landing, in which a board reads less than in the air
SHIFT_STD_COUNT, SHIFT_STD = 0.3, 0.05  # standard deviation of the mean shift: of readings, and relative
LEAST_RATIO = 1.5  # of the step to the scatter of the lowest readings before and after


def correct_rezeros(foot: FootRecording, seen: WrenchObservation) -> tuple[WrenchObservation, list[Finding]]:
    """Return `seen` with the missing load added to later readings of re-zeroed boards, and a finding for each board.

    On a walk the foot rolls on during the re-zero, so the missing load is known only roughly: rows since the foot was
    last in the air before it are dropped if LEAST_WALK_S are left.
    """
    findings: list[Finding] = []
    boards = seen.layout.identities[:, 0]
    no_load = {board.address: board.no_load for board in foot.boards if board.no_load is not None}
    width = max(round(MOST_STEP_S / seen.step_s), 2)
    for board, landing_count in sorted(no_load.items()):
        of_board = boards == board
        find, is_walking = (_find_rezero if seen.load_is_known else _find_landing), False
        row = find(seen, of_board, float(landing_count), width)
        if row is None and not seen.load_is_known:
            row, is_walking = _find_rezero_of_walk(seen, of_board, width), True
        if row is None:
            continue
        before, after = (rows[0] for rows in _read_beside(seen, of_board, np.array([row]), width))
        if is_walking:
            change = _change_of_walk(seen, of_board, int(before), int(after))
        else:
            change = seen.activation_count[before, of_board] - seen.activation_count[after, of_board]
        if seen.load_is_known:
            change += seen.expected_count[after, of_board] - seen.expected_count[before, of_board]
        shift = np.where(seen.usable[of_board], change, 0.0)
        mean_shift = float(shift[seen.usable[of_board]].mean())
        corrected = _corrected(seen, of_board, slice(before, after), row, shift)
        if seen.load_is_known:
            explains = mean_shift**2 * float(np.mean(of_board)) * (1.0 - row / len(seen.t_s))
        else:
            explains = float(np.mean((corrected.wrench[:, 0] - seen.wrench[:, 0]) ** 2))
        last = row if seen.load_is_known else _last_in_air(seen, of_board, int(before))
        findings.append(_finding(seen, int(board), row, last, mean_shift, explains))
        if not seen.load_is_known and seen.t_s[last] - seen.t_s[0] > LEAST_WALK_S:
            corrected = seen.rows_before(last)
        seen = corrected
    return seen, findings


def _change_of_walk(seen: WrenchObservation, of_board: NDArray[np.bool_], before: int, after: int) -> Array:
    """Return by how much less the taxels (k, 12) of a board read since a re-zero under a walking foot.

    From the row `before` it to that `after` it the load changes, too, so this is the difference of readings in the air;
    of a taxel at the end of its range there, that under high loads.
    """
    outer = (LOW_QUANTILE, 1.0 - LOW_QUANTILE)
    low_before, high_before = np.quantile(seen.activation_count[: before + 1, of_board], outer, axis=0)
    low_after, high_after = np.quantile(seen.activation_count[after:, of_board], outer, axis=0)
    low, high = low_before - low_after, high_before - high_after
    is_cut_off = seen.cut_off[after:, of_board].mean(axis=0) > LOW_QUANTILE / 2.0
    return np.asarray(np.where(is_cut_off, np.maximum(low, high), low))


def _last_in_air(seen: WrenchObservation, of_board: NDArray[np.bool_], before: int) -> int:
    """Return the last row until `before` in which a board bears nothing, so that its re-zero comes later.

    The row of the re-zero is that of a fall of its readings, which may be that at the end of the step, or later if the
    board reads beyond its range. A pause shortly before may be that in which it zeroed itself.
    """
    paused = seen.missing[: before + 1, of_board].any(axis=1) & (seen.t_s[before] - seen.t_s[: before + 1] < PAUSE_S)
    before = int(np.argmax(paused)) if paused.any() else before
    level = seen.activation_count[: before + 1, of_board][:, seen.usable[of_board]].mean(axis=1)
    is_low = np.abs(level - np.quantile(level, LOW_QUANTILE)) < LEAST_WALK_STEP_COUNT
    in_air = np.flatnonzero(is_low[1:] & is_low[:-1])
    return int(in_air[-1]) + 1 if in_air.size else before


def _finding(
    seen: WrenchObservation, board: int, row: int, last: int, mean_shift_count: float, explains: float
) -> Finding:
    """Return the finding of a re-zero at `row`, which was later than the row `last`."""
    where = Where("board", ((board,),))
    t_s = float(seen.t_s[row])
    t_std_s = float(np.hypot(seen.step_s, (t_s - seen.t_s[last]) / np.sqrt(12.0)))
    shift_std_count = float(np.hypot(SHIFT_STD_COUNT, SHIFT_STD * mean_shift_count))
    return Finding(
        effect="rezero", foot=seen.layout.foot, where=where, recordings=(seen.name,),
        when_s=((t_s, float(seen.t_s[-1])),), equation=laws()["rezero"].equation, explains=explains,
        parameters={
            "t_s": Quantity(t_s, t_std_s, "s"),
            "shift_count": Quantity(mean_shift_count, shift_std_count, "count"),
        },
        sentence=f"{place_in_words(where)} took its baselines anew at {t_s:.1f} s under load: "
        f"{mean_shift_count:+.1f} counts are missing since.",
    )  # fmt: skip


def _read_beside(
    seen: WrenchObservation, of_board: NDArray[np.bool_], rows: NDArray[np.intp], width: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the last rows with readings of a board at least `width` before `rows`, and the first as much after them.

    A board that zeroes itself may send nothing meanwhile.
    """
    is_read = np.asarray(~seen.missing[:, of_board].any(axis=1))
    numbers = np.arange(len(is_read))
    last = np.maximum.accumulate(np.where(is_read, numbers, 0))
    first = np.minimum.accumulate(np.where(is_read, numbers, numbers[-1])[::-1])[::-1]
    return last[np.maximum(rows - width, 0)], first[np.minimum(rows + width, numbers[-1])]


def _corrected(
    seen: WrenchObservation, of_board: NDArray[np.bool_], during: slice, row: int, shift: Array
) -> WrenchObservation:
    """Return `seen` with `shift` (k, 12) counts added to the k triangles `of_board` (T,) from `row` on.

    Rows `during` the re-zero are missing.
    """
    activation, missing = seen.activation_count.copy(), seen.missing.copy()
    cut_off = seen.cut_off[row:, of_board]
    is_cut_off = cut_off.any(axis=2)
    missing[row:, of_board] |= is_cut_off | (seen.load_is_known and is_cut_off.mean() > MOST_CUT_OFF)
    missing[during, of_board] = True
    activation_later = activation[row:, of_board] + shift
    # A reading at an end of the range bears less than the missing load; on a walk mostly none.
    activation[row:, of_board] = activation_later if seen.load_is_known else np.where(cut_off, 0.0, activation_later)
    rezeroed = np.zeros(missing.shape, bool) if seen.rezeroed is None else seen.rezeroed.copy()
    rezeroed[row:, of_board] = True
    return replace(seen, activation_count=activation, missing=missing, rezeroed=rezeroed)


def _find_rezero(seen: WrenchObservation, of_board: NDArray[np.bool_], landing_count: float, width: int) -> int | None:
    """Return the row at which a board's taxels jump to `landing_count` under a known load, or None.

    Only rows whose load is known count. Later readings also have to be below those of no load, which no load can cause,
    while the load is less than that of the re-zero; beside a simulation at any time, because a simulated load may stay
    where the person's ends.
    """
    usable = seen.usable[of_board]
    if not usable.any():
        return None
    activation = seen.activation_count[:, of_board][:, usable]
    landing_activation = seen.calibration.baseline_count[of_board][usable] - landing_count
    near_count = LANDING_COUNT + 3.0 * seen.noise_count[of_board][usable]
    expected_activation = seen.expected_count[:, of_board][:, usable]
    above_landing = (activation - landing_activation).mean(axis=1)
    expected = (expected_activation - landing_activation).mean(axis=1)
    is_known = seen.reference.is_known(seen.reference_s)
    rows = np.arange(width, len(activation) - width)
    before, after = _read_beside(seen, of_board, rows, width)
    stays_loaded = np.minimum(expected[before], expected[after]) > LEAST_LOAD_COUNT
    is_loaded = above_landing[before] > LEAST_LOAD_COUNT
    candidates = [
        k
        for k in np.flatnonzero(is_known[before] & is_known[after] & stays_loaded & is_loaded).tolist()
        if _has_landed(
            activation[after[k]] - landing_activation, expected_activation[before[k] : after[k] + 1], near_count
        )
    ]
    cut_off = seen.cut_off[:, of_board][:, usable].mean(axis=1) > MOST_ELSEWHERE
    missing_count = np.where(is_known, expected - above_landing, np.nan)  # what readings miss
    expected = np.where(is_known & ~cut_off, expected, np.nan)
    by_others = _missing_by_others(seen, of_board)
    for beside_count in [0.0] if by_others is None else [0.0, by_others]:
        missing = missing_count - beside_count
        for k in candidates:
            last, first = int(before[k]), int(after[k])
            step_count = float(
                above_landing[last] - above_landing[first]
                if seen.is_uniform and by_others is None  # a memory of the board also changes what readings miss
                else missing[first] - missing[last]
            )
            if (
                _is_missing_since(missing, last, first, step_count, ~cut_off, round(LEAST_DURATION_S / seen.step_s))
                and (
                    _falls_below_no_load(activation[first:])
                    if isinstance(seen, PairedObservation)
                    else _lacks_load(above_landing[first:], expected[first:], step_count)
                )
                and (not seen.is_uniform or _is_steady(missing[first:][~cut_off[first:]], step_count))
                and not _is_part_of_load(missing[first:], expected[first:])
            ):
                steps = np.nan_to_num(np.diff(missing[last : first + 1]), nan=-np.inf)
                return last + 1 + int(np.argmax(steps))
    return None


def _has_landed(above_landing: Array, expected: Array, near_count: Array) -> bool:
    """Return whether taxels landed during some row of a step, `above_landing` (k,) of them after it.

    `expected` (m, k): the activations under the load in each row of the step. The load changes after the landing, too.
    """
    later_load = expected[-1] - expected
    is_near = np.abs(above_landing - later_load) < near_count
    return bool(is_near.mean(axis=1).max() > 1.0 - MOST_ELSEWHERE)


def _missing_by_others(seen: WrenchObservation, of_board: NDArray[np.bool_]) -> Array | None:
    """Return what the readings of other boards miss (N,), counts, under a uniform load; None if there are none.

    A memory of the whole insole lets readings differ from the load on all boards alike, a re-zero on one.
    """
    others = seen.usable & ~of_board[:, None]
    if not seen.is_uniform or not others.any():
        return None
    return np.asarray((seen.expected_count - seen.activation_count)[:, others].mean(axis=1))


def _is_missing_since(
    missing_count: Array,
    last: int,
    first: int,
    step_count: float,
    in_range: NDArray[np.bool_],
    least_rows: int,
) -> bool:
    """Return whether readings miss (N,) about `step_count` from row `first` to the end, and nothing until `last`.

    A pulse ends and late readings catch up; after a re-zero the load is missing until the end. Where `in_range` (N,) is
    False, readings are at an end of their range. NaN: the load is not known.
    """
    if missing_count[first] - missing_count[last] < LEAST_LOAD_COUNT:
        return False  # the load itself changed
    is_later = np.isfinite(missing_count[first:])
    later, is_shown = missing_count[first:][is_later], in_range[first:][is_later]
    soon, is_soon_shown = later[:least_rows], is_shown[:least_rows]
    if (
        len(later) < least_rows
        or step_count < LEAST_LOAD_COUNT
        or np.median(soon[is_soon_shown] if is_soon_shown.any() else soon) < LEAST_LOAD_COUNT
        or abs(float(np.nanmedian(missing_count[:last]))) > LEAST_LOAD_COUNT
    ):
        return False
    return bool(
        is_shown.sum() < LEAST_ROWS
        or MISSING_RATIO[0] * step_count < np.median(later[is_shown]) < MISSING_RATIO[1] * step_count
    )


def _is_steady(missing_count: Array, step_count: float) -> bool:
    """Return whether readings (N,) never miss much less than `step_count`, as those of a memory or a wrong curve do."""
    known = missing_count[np.isfinite(missing_count)]
    return len(known) < LEAST_ROWS or float(np.quantile(known, STEADY_QUANTILE)) > STEADY_RATIO * step_count


def _is_part_of_load(missing_count: Array, expected: Array) -> bool:
    """Return whether readings (N,) miss a part of the load rather than the same at any load: a gain or a bit shift.

    `expected` (N,): by the load; NaN where either is not known.
    """
    known = np.isfinite(missing_count) & np.isfinite(expected)
    if known.sum() < LEAST_ROWS:
        return False
    missing, load = missing_count[known], expected[known]
    part = missing - load * (missing @ load) / max(float(load @ load), 1e-12)
    return bool(part @ part < LESS_AS_PART * np.sum((missing - missing.mean()) ** 2))


def _falls_below_no_load(activation: Array) -> bool:
    """Return whether activations (N, k) of a board are below those of no load for some of the time."""
    return bool(np.quantile(activation.mean(axis=1), BELOW_QUANTILE) < -LANDING_COUNT)


def _lacks_load(above_landing: Array, expected: Array, step_count: float) -> bool:
    """Return whether readings (N,) are below those of no load while the load is clearly less than that of the re-zero.

    `expected` (N,): by the load, NaN if it is not known or the readings are at an end of their range. Also True if the
    load stays higher.
    """
    is_less = expected < step_count - LANDING_COUNT
    return bool(is_less.sum() < LEAST_ROWS or np.median(above_landing[is_less]) < 0.0)


def _find_landing(seen: WrenchObservation, of_board: NDArray[np.bool_], landing_count: float, width: int) -> int | None:
    """Return the row of a re-zero of a board under a standing person; None if there is none.

    In that row all its taxels jump to `landing_count`, the count of no load. They hardly change in the `width` rows
    before and after it, and later, in the air, the board reads below no load by the size of the jump.

    Two other jumps look alike. One is the end of a step: the next step changes the readings soon, while those of a
    standing person hardly change until the foot is lifted. The other is a step after an earlier re-zero: shortly before
    it, the board already reads less than it did in the air.
    """
    usable = seen.usable[of_board]
    if not usable.any():
        return None
    activation = seen.activation_count[:, of_board][:, usable]
    level = activation.mean(axis=1)
    landing_activation = seen.calibration.baseline_count[of_board][usable] - landing_count
    near_count = LANDING_COUNT + 3.0 * seen.noise_count[of_board][usable]
    is_near = (np.abs(activation - landing_activation) < near_count).mean(axis=1) > 1.0 - MOST_ELSEWHERE

    def change_count(first: int, last: int) -> Array:
        """Return the RMS change of the taxels between two rows relative to each of `rows`."""
        return np.asarray(np.sqrt(np.mean((activation[rows + last] - activation[rows + first]) ** 2, axis=1)))

    far, stretch_rows = JUMP_ROWS + width, round(STRETCH_S / seen.step_s)
    rows = np.arange(far, len(level) - far)
    if not len(rows):
        return None
    calm_count = np.maximum(change_count(-far, -JUMP_ROWS), change_count(JUMP_ROWS, far))
    drop_count = level[rows - JUMP_ROWS] - level[rows + JUMP_ROWS]
    is_jump = (drop_count > LEAST_WALK_STEP_COUNT) & (change_count(-JUMP_ROWS, JUMP_ROWS) > CALM_RATIO * calm_count)
    for i in np.flatnonzero(is_jump & is_near[rows + JUMP_ROWS] & ~is_near[rows - JUMP_ROWS]).tolist():
        row = int(rows[i])
        lacking_count = float(landing_activation.mean() - np.quantile(level[row:], LOW_QUANTILE))
        if not 0.5 * drop_count[i] < lacking_count < 1.5 * drop_count[i]:
            continue
        air_count = float(np.quantile(level[:row], LOW_QUANTILE))
        if np.mean(level[max(row - stretch_rows, 0) : row] < air_count - LEAST_WALK_STEP_COUNT) > MOST_BELOW:
            continue
        later_count = level[row + JUMP_ROWS :]
        standing_rows = int(np.argmax(later_count < landing_activation.mean() - 0.5 * drop_count[i]))
        if standing_rows > width and np.std(later_count[:standing_rows]) < STANDING_RATIO * drop_count[i]:
            return row
    return None


def _find_rezero_of_walk(seen: WrenchObservation, of_board: NDArray[np.bool_], width: int) -> int | None:
    """Return the row at which a board re-zeroes on a walk, or None.

    From then on its readings in the air are below those of no load. Only readings are used, because the clock of the
    reference is not known yet. The count it lands on is not used: the foot rolls on during the re-zero.
    """
    usable = seen.usable[of_board]
    if not usable.any():
        return None
    level = seen.activation_count[:, of_board][:, usable].mean(axis=1)
    stretch_rows = round(STRETCH_S / seen.step_s)
    low_count = _low_readings(level, stretch_rows)
    for k in range(LEAST_STRETCHES, len(low_count) - LEAST_STRETCHES):
        # The lowest reading before, however long the person stood, and those of the first stretches after.
        air_before, air_after = float(low_count[:k].min()), low_count[k : k + LEAST_STRETCHES]
        scatter = max(float(np.quantile(low_count[:k], AIR_QUANTILE)) - air_before, float(np.ptp(air_after)))
        step_count = air_before - float(air_after.max())
        if (
            step_count > max(LEAST_WALK_STEP_COUNT, LEAST_RATIO * scatter)
            and float(np.median(low_count[k:])) < air_before - 0.5 * step_count
            and air_before < LEAST_LOAD_COUNT
            and air_after.max() < -LEAST_WALK_STEP_COUNT
        ):
            stance_rows = round(STANCE_S / seen.step_s)
            stretch = (k - 1) * stretch_rows  # before it, single readings below are an undershoot of the interpolation
            floor_count = air_before - 0.5 * step_count
            row = stretch + _last_drop(level[stretch:], floor_count, 0.5 * step_count, width, stance_rows)
            paused = _only_pause(seen, of_board, slice(stretch - stretch_rows, row))
            return row if paused is None else paused
    return None


def _only_pause(seen: WrenchObservation, of_board: NDArray[np.bool_], during: slice) -> int | None:
    """Return the middle row of the only pause of a board in the rows `during`, or None.

    In a pause the board sends nothing and the other boards do. It tells the time of a re-zero better than readings that
    are beyond their range in the air from then on, and are interpolated there.
    """
    missing = seen.missing[during]
    is_pause = np.asarray(missing[:, of_board].all(axis=1) & ~missing[:, ~of_board].all(axis=1))
    pauses = [(first, last) for first, last in stretches(is_pause) if last > first]
    return (during.start + sum(pauses[0]) // 2) if len(pauses) == 1 else None


def _last_drop(level: Array, floor: float, least: float, width: int, stance: int) -> int:
    """Return the row of the last drop of at least `least` before `level` (N,) first falls below `floor`.

    Without one in the `stance` rows before, it is the row at which it falls. A board that re-zeroes while the foot
    rolls off it falls from the load to below no load in one step.
    """
    first = int(np.argmax(level < floor))
    if first and level[first - 1] > floor + 2.0 * least:
        return first + width // 2
    rows = np.arange(max(first - stance, 0), max(first, 1))
    drop_count = level[rows] - level[np.minimum(rows + width, rows[-1])]
    drop_rows = rows[drop_count > least]
    if not len(drop_rows):
        return first
    is_near = (rows >= drop_rows[-1] - width) & (rows <= drop_rows[-1])
    return int(rows[is_near][np.argmax(drop_count[is_near])]) + width // 2


def _low_readings(level: Array, rows: int) -> Array:
    """Return a low quantile of each stretch of `rows` rows: interpolation of steep edges undershoots the minimum."""
    return np.asarray(np.quantile(level[: len(level) // rows * rows].reshape(-1, rows), LOW_QUANTILE, axis=1))
