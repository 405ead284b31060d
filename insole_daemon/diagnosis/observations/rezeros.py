"""Boards that took their baselines anew under a load: from one reading to the next all taxels say that there is none.

`no_load` is where the firmware lands; what the load was then is missing from every later reading.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...physics.effect import Where
from ...physics.effects import laws
from ...physics.law import Array
from ...recording.loading import FootRecording
from ..finding import Finding, Quantity
from ..places import said
from .wrench import WrenchObservation

LEAST_COUNT = 5.0  # of load, on the average of a board: less is no step that could be told
LEAST_STEP_COUNT = 2.0  # the same on a walk, of the lowest readings
NEAR_COUNT = 2.5  # of a taxel to where a rezero lands, beside three standard deviations of its noise
MOST_OFF = 0.1  # of the taxels, that land elsewhere
MOST_LOST = 0.3  # of what is read afterwards: the rest is the load's peaks alone
LASTS_S = 3.0
MISSING = (0.5, 1.6)  # times what the step took, that is missing on the median until the end
LEAST_READ = 50  # rows that are not cut off, to ask that of
STEP_S = 0.12  # that it takes at the most, each way
STEPS_S, LEAST_STEPS = 2.0, 3  # in which a foot is lifted once, and as many before and after
ENOUGH_S = 20.0  # of a walk, to leave out the rest
LOWEST = 0.1  # of the rows of a stretch, in which a foot that walks is in the air
AIR_QUANTILE = 0.25  # of the lowest readings of stretches: those in which the foot was lifted
CLEAR = 1.5  # times what the lowest readings of stretches in which it was lifted differ by, before and after


def with_rezeros(foot: FootRecording, seen: WrenchObservation) -> tuple[WrenchObservation, list[Finding]]:
    """`seen` with what later readings miss added again, and what is said of it.

    On a walk the foot rolls on while the board says nothing, and what is missing is known roughly: later rows are left
    out where enough are left.
    """
    findings: list[Finding] = []
    boards = seen.layout.identities[:, 0]
    no_load = {board.address: board.no_load for board in foot.boards if board.no_load is not None}
    width = max(round(STEP_S / seen.step_s), 2)
    for board, lands in sorted(no_load.items()):
        own = boards == board
        at = _step(seen, own, float(lands), width) if seen.load_is_known else _step_of_walk(seen, own, width)
        if at is None:
            continue
        shift = seen.activation_count[at - width, own] - seen.activation_count[at + width, own]
        shift = np.where(seen.usable[own], shift, 0.0)
        size, t_s, n = float(shift[seen.usable[own]].mean()), float(seen.t_s[at]), len(seen.t_s)
        right = _put_right(seen, own, at, width, shift)
        if seen.load_is_known:
            explains = size**2 * float(np.mean(own)) * (1.0 - at / n)
        else:
            explains = float(np.mean((right.wrench[:, 0] - seen.wrench[:, 0]) ** 2))
        findings.append(
            Finding(
                effect="rezero", foot=seen.layout.foot, where=Where("board", ((int(board),),)),
                recordings=(seen.name,), when_s=((t_s, float(seen.t_s[-1])),), equation=laws()["rezero"].equation,
                parameters={"t_s": Quantity(t_s, seen.step_s, "s"), "shift_count": Quantity(size, 0.3, "count")},
                explains=explains,
                sentence=f"{said(Where('board', ((int(board),),)))} took its baselines anew at {t_s:.1f} s under load: "
                f"{size:+.1f} counts are missing since.",
            )
        )  # fmt: skip
        is_enough = not seen.load_is_known and seen.t_s[at - width] - seen.t_s[0] > ENOUGH_S
        seen = seen.until(at - width) if is_enough else right
    return seen, findings


def _put_right(
    seen: WrenchObservation, own: np.ndarray[tuple[int], np.dtype[np.bool_]], at: int, width: int, shift: Array
) -> WrenchObservation:
    """With the counts `shift` (k, 12) added to the triangles `own` from row `at` on."""
    activation, missing = seen.activation_count.copy(), seen.missing.copy()
    cut_off = seen.cut_off[at:, own]
    lost = cut_off.any(axis=2)
    missing[at:, own] |= lost | (seen.load_is_known and lost.mean() > MOST_LOST)
    missing[at - width : at + width, own] = True
    later = activation[at:, own] + shift
    # Less than was taken presses there; on a walk mostly nothing, for the foot has rolled off it.
    activation[at:, own] = later if seen.load_is_known else np.where(cut_off, 0.0, later)
    rezeroed = np.zeros(missing.shape, bool) if seen.rezeroed is None else seen.rezeroed.copy()
    rezeroed[at:, own] = True
    return replace(seen, activation_count=activation, missing=missing, rezeroed=rezeroed)


def _step(
    seen: WrenchObservation, own: np.ndarray[tuple[int], np.dtype[np.bool_]], lands: float, width: int
) -> int | None:
    """The row from which on a board's taxels start anew at the count `lands`; None: they never do."""
    usable = seen.usable[own]
    if not usable.any():
        return None
    activation = seen.activation_count[:, own][:, usable]
    rest = seen.calibration.baseline_count[own][usable] - lands
    near = np.abs(activation - rest) < NEAR_COUNT + 3.0 * seen.noise_count[own][usable]
    landed = near.mean(axis=1) > 1.0 - MOST_OFF
    loaded = (activation - rest).mean(axis=1) > LEAST_COUNT
    expected = (seen.expected_count[:, own][:, usable] - rest).mean(axis=1)
    rows = np.arange(width, len(activation) - width)
    loads = np.minimum(expected[rows - width], expected[rows + width]) > LEAST_COUNT
    steps = rows[loaded[rows - width] & landed[rows + width] & loads]
    cut_off = seen.cut_off[:, own][:, usable].mean(axis=1) > MOST_OFF
    away = expected - (activation - rest).mean(axis=1)  # what readings miss
    for row in steps.tolist():
        if away[row + width] - away[row - width] < LEAST_COUNT:
            continue  # the load did it
        # A pulse is over at once, readings that come late catch up; what a rezero takes is missing from then on.
        taken = float(np.mean(activation[row - width] - activation[row + width]))
        later, reads = away[row + width :], ~cut_off[row + width :]
        soon = later[: round(LASTS_S / seen.step_s)]
        if (
            taken < LEAST_COUNT
            or np.median(soon) < LEAST_COUNT
            or abs(float(np.median(away[: row - width]))) > LEAST_COUNT
        ):
            continue
        if reads.sum() < LEAST_READ or MISSING[0] * taken < np.median(later[reads]) < MISSING[1] * taken:
            return int(row) + width // 2
    return None


def _step_of_walk(seen: WrenchObservation, own: np.ndarray[tuple[int], np.dtype[np.bool_]], width: int) -> int | None:
    """As `_step` where the load is not known: what is taken on the ground is missing in the air from then on.

    By readings alone, for the reference's clock is told by them. Where it lands nobody sees: the foot rolls on while
    the board says nothing.
    """
    usable = seen.usable[own]
    if not usable.any():
        return None
    level = seen.activation_count[:, own][:, usable].mean(axis=1)
    long = round(STEPS_S / seen.step_s)
    lowest = _lowest(level, long)
    for k in range(LEAST_STEPS, len(lowest) - LEAST_STEPS):
        # In the air before, however long the person stood there; and soon after, below what no load reads.
        air, after = float(lowest[:k].min()), lowest[k : k + LEAST_STEPS]
        scatter = max(float(np.quantile(lowest[:k], AIR_QUANTILE)) - air, float(np.ptp(after)))
        taken = air - float(after.max())
        if (
            taken > max(LEAST_STEP_COUNT, CLEAR * scatter)
            and float(np.median(lowest[k:])) < air - 0.5 * taken
            and air < LEAST_COUNT
            and after.max() < -LEAST_STEP_COUNT
        ):
            return _last_drop(level, air - 0.5 * taken, 0.5 * taken, width)
    return None


def _last_drop(level: Array, floor: float, least: float, width: int) -> int:
    """The row of the last drop of at least `least` until `level` falls below `floor` for the first time.

    A board that says nothing while the foot rolls off it falls from the load to below no load at once.
    """
    first = int(np.argmax(level < floor))
    if first and level[first - 1] > floor + 2.0 * least:
        return first + width // 2
    rows = np.arange(max(first, 1))
    drop = level[rows] - level[np.minimum(rows + width, rows[-1])]
    falls = rows[drop > least]
    if not len(falls):
        return first
    last = rows[max(int(falls[-1]) - width, 0) : int(falls[-1]) + 1]
    return int(last[np.argmax(drop[last])]) + width // 2


def _lowest(level: Array, rows: int) -> Array:
    """A low quantile of each stretch of so many rows: cubics through edges of the load fall lower for a moment."""
    return np.asarray(np.quantile(level[: len(level) // rows * rows].reshape(-1, rows), LOWEST, axis=1))
