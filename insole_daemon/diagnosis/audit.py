"""What is wrong with the readings themselves, before any physics: masked from the fit, and reported.

Everything is told from the counts and the cycles' own flags. The mean of the insole's readings stands for the load
here: the reference's clock is not known yet.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from ..physics.effect import Where
from ..physics.law import Array
from ..recording.loading import FootRecording
from ..skin.geometry import N_TAXELS, PRESSURE_TAXELS
from .finding import Finding
from .floor import LEAST_COUNT, noise_of_readings
from .observed import stretches
from .places import said, where

SAME_S = 4.0  # a working taxel does not say one number for so long while the load moves
TALKS = 0.25  # as often as the liveliest taxels do: one that changes more seldom tells little of the load
MOVED = 0.15  # of the insole's range: the load moved
MOST_INVALID = 0.1  # of a taxel's cycles: more, and it is left out
MOST_DEAD = 0.3  # of its cycles: more, and the taxel is called dead; less may be the load's or the zero's doing
RAIL_SIGMAS, RAIL_CYCLES, MOST_ON_RAILS = 2.5, 15, 0.2  # how near an end, over how many cycles, how many taxels
OPEN_S = 0.3  # how long a triangle is silent before it is called open
ALWAYS = 0.95  # of the time: from beginning to end
OPEN_TAXELS = 8  # of a triangle's ten that fail together: the triangle has lost contact
LOUD = 2.5  # times its usual noise: a burst
BOARD_LOUD = 2.0  # times its quietest tenth, of a board's typical taxel: the board has another state
# Further than the other taxels from one cycle to the next (a snap is less), and how often: a loose contact.
LEAP_COUNT, LEAPS = 45.0, 2
MOST_LEAPING = 0.5  # of the taxels: as many loose contacts there are not
BURST_S = 0.3
WINDOW_S = 1.0
GAP_PERIODS = 1.6
MOST_LOST = 0.003  # of all cycles: fewer are what a bus loses
FROZEN = 0.9  # of the cycles without a new reading: the triangle is not there, whatever it says
REPEATS = 5  # equal readings of all of a triangle in a row: no converter is that slow


# E|z| of a normal variable without its largest fifth: (φ(0) − φ(1.2816)) · 2 / 0.8.
_MEAN_OF_FOUR_FIFTHS = 0.5586


@dataclass(frozen=True, slots=True, eq=False)
class Audit:
    """Which readings are fit to be explained, and what was found out about the others."""

    kept: NDArray[np.bool_]  # (n_triangles, 12)
    cycles: NDArray[np.bool_]  # (n,)
    findings: tuple[Finding, ...]


def audit(foot: FootRecording, name: str, steps: bool = False) -> Audit:
    """The readings of one foot in recording `name`; `steps`: it is walked on.

    A heel strike is as short as noise: then bursts and noisy boards are not looked for, and leaps that stay are none.
    """
    n, k = len(foot), len(foot.layout)
    t_s = (foot.t_ns - foot.t_ns[0]) * 1e-9
    counts = foot.counts.reshape(n, -1).astype(np.float64)
    valid = foot.valid.reshape(n, -1)
    asked = np.flatnonzero(_asked(foot).ravel())
    mean = _insole(counts[:, asked])
    silent = _dead(counts[:, asked], valid[:, asked], t_s, mean)
    dead = np.zeros((n, k * N_TAXELS), bool)
    dead[:, asked] = silent
    came_not = _lost(foot, t_s)
    frozen = came_not.mean(axis=0) > FROZEN
    if not frozen.all():  # else the load never moved
        dead[:, asked] |= frozen[asked // N_TAXELS]
    # Where many stand at an end of their range together it is the rest counts that have wandered off, not the taxels.
    railed = _on_rails(counts[:, asked])
    share = dead[~railed][:, asked].mean(axis=0)
    bad = np.zeros(k * N_TAXELS, bool)
    bad[asked] = share > MOST_INVALID
    findings: list[Finding] = []
    # Readings at the upper end are a rest count that has wandered off, not a line without a triangle.
    silent_now = (dead & (counts < 255)).reshape(n, k, N_TAXELS)
    opened = _open(silent_now, t_s)
    apart: dict[tuple[tuple[float, float], ...], list[int]] = {}
    for row in opened:
        slots = row * N_TAXELS + np.flatnonzero(PRESSURE_TAXELS)
        if bad[slots].sum() >= OPEN_TAXELS:  # what its last taxels say is not to be believed either
            bad[slots] = True
        silent_together = np.asarray(silent_now[:, row].sum(axis=1) >= OPEN_TAXELS)
        when = _joined(intervals(silent_together, t_s), 1.0) if silent_together.mean() < ALWAYS else ()
        apart.setdefault(when, []).append(row)
    for when, rows_of in apart.items():
        text = "lost contact: " + ("its taxels fail" if len(rows_of) == 1 else "the taxels of each fail") + " together"
        place = Where("triangle", tuple(tuple(identity) for identity in foot.layout.identities[rows_of].tolist()))
        findings.append(_finding("open_triangle", foot, name, place, when, text + ("" if when else ", all along")))
    loud = np.zeros_like(bad)
    boards = foot.layout.identities[:, 0]
    for slots, when in () if steps else _loud_boards(counts, asked[~bad[asked]], boards, t_s):
        loud[slots] = True
        text = "is far noisier in some stretches than in others, too long to leave them out: the board is left out"
        findings.append(_finding("noise_burst", foot, name, slots, when, text))
    leaping = _leaps(counts[:, asked], valid[:, asked], steps) >= LEAPS
    if leaping.mean() < MOST_LEAPING:  # else it is how this insole answers, and no contact
        bad[asked] |= ~loud[asked] & leaping
    gone = np.zeros_like(bad)
    gone[asked] = bad[asked] & ((share > MOST_DEAD) | (share <= MOST_INVALID))
    lone = np.array([slot for slot in np.flatnonzero(gone) if slot // N_TAXELS not in opened], np.intp)
    if lone.size:
        when = intervals(np.asarray(dead[:, lone].any(axis=1)), t_s)
        always = dead[:, lone].mean() > ALWAYS
        text = "say the same number while the load moves, leap, or say none that can be believed"
        findings.append(_finding("dead_taxels", foot, name, lone, () if always else when, text))
    # What a triangle without a taxel to believe lacks is no cycle's loss: one that is not there says the same for ever.
    lost = came_not & (~bad.reshape(k, N_TAXELS) & _asked(foot)).any(axis=1)
    bad |= loud
    fresh: NDArray[np.bool_] = ~np.any(lost, axis=1)
    quiet_of = np.empty(0, np.intp) if steps else np.flatnonzero(~bad & np.isin(np.arange(bad.size), asked))
    quiet, bursts = _bursts(counts, lost, quiet_of, t_s)
    for slots, when in bursts:
        findings.append(_finding("noise_burst", foot, name, slots, when, "far noisier than usual for a while"))
    if (~fresh).mean() > MOST_LOST:
        rows = np.flatnonzero(lost.mean(axis=0) > MOST_LOST)
        slots = (rows[:, None] * N_TAXELS + np.flatnonzero(PRESSURE_TAXELS)).ravel()
        when = _joined(intervals(~fresh, t_s), 1.0)
        spread = sum(b - a for a, b in when) > 0.5 * t_s[-1] or len(when) > 40
        text = f"{lost[:, rows].mean():.1%} of the readings did not come, or came again unchanged"
        findings.append(_finding("frame_loss", foot, name, slots, () if spread else when, text))
    kept = ~bad.reshape(k, N_TAXELS) & _asked(foot)
    return Audit(kept, fresh & quiet & ~_on_rails(counts[:, kept.ravel()]), tuple(findings))


def intervals(flags: NDArray[np.bool_], t_s: Array) -> tuple[tuple[float, float], ...]:
    """From when to when `flags` (n,) are set."""
    return tuple((float(t_s[a]), float(t_s[b])) for a, b in stretches(flags))


def _finding(
    effect: str, foot: FootRecording, name: str, place: Where | NDArray[np.intp],
    when: Iterable[tuple[float, float]], text: str,
) -> Finding:  # fmt: skip
    if not isinstance(place, Where):
        place = where(place, np.flatnonzero(np.tile(PRESSURE_TAXELS, len(foot.layout))), foot.layout)
    return Finding(
        effect=effect, foot=foot.foot, where=place, sentence=f"{said(place)}: {text}.", recordings=(name,),
        when_s=tuple(when),
    )  # fmt: skip


def _asked(foot: FootRecording) -> NDArray[np.bool_]:
    """(n_triangles, 12) taxels that have pressure to tell: all ten of a triangle, or what a calibration lists."""
    asked = np.tile(PRESSURE_TAXELS, (len(foot.layout), 1))
    return asked if foot.calibration is None else asked & foot.calibration.usable


def _insole(counts: Array) -> Array:
    """(n,) what a typical taxel says, over its range; most of an insole may not be there, and say one number."""
    often = np.mean(np.diff(counts, axis=0) != 0, axis=0)
    middle = np.median(counts[:, often >= TALKS * np.quantile(often, 0.95)], axis=1)
    span = float(np.ptp(middle)) or 1.0
    found: Array = (middle.max() - middle) / span
    return found


def _dead(counts: Array, valid: NDArray[np.bool_], t_s: Array, mean: Array) -> NDArray[np.bool_]:
    """(n, m) not to be believed, or one number for long while the load moved."""
    dead = ~valid
    for i in range(counts.shape[1]):
        change = np.flatnonzero(np.diff(counts[:, i]) != 0)
        starts, ends = np.append(0, change + 1), np.append(change, len(t_s) - 1)
        for a, b in zip(starts[t_s[ends] - t_s[starts] > SAME_S], ends[t_s[ends] - t_s[starts] > SAME_S], strict=True):
            if np.ptp(mean[a : b + 1]) > MOVED:
                dead[a : b + 1, i] = True
    return dead


def _leaps(counts: Array, valid: NDArray[np.bool_], steps: bool) -> NDArray[np.intp]:
    """(m,) how often a taxel alone leapt from one cycle to the next; of `steps`, and at once back again.

    Where a heel strikes, some taxels leap and the others do not; but then they bear that load for a while.
    """
    change = np.diff(counts, axis=0)
    change -= np.median(change, axis=1, keepdims=True)
    leaps = np.where((np.abs(change) > LEAP_COUNT) & valid[1:] & valid[:-1], np.sign(change), 0.0)
    if steps:
        leaps = np.where(leaps[1:] * leaps[:-1] < 0, leaps[1:], 0.0)
    found: NDArray[np.intp] = np.count_nonzero(leaps, axis=0)
    return found


def _open(open_now: NDArray[np.bool_], t_s: Array) -> list[int]:
    """Rows of triangles most of whose taxels (n, n_triangles, 12) say nothing for OPEN_S or longer."""
    together = open_now.sum(axis=2) >= OPEN_TAXELS
    return [
        row for row in range(together.shape[1])
        if any(t_s[b] - t_s[a] >= OPEN_S for a, b in stretches(together[:, row]))
    ]  # fmt: skip


def _on_rails(counts: Array) -> NDArray[np.bool_]:
    """(n,) cycles in which many taxels stand so near an end of their range that it cuts their noise off."""
    near = RAIL_SIGMAS * float(np.median(noise_of_readings(counts))) if counts.size else 0.0
    usual = uniform_filter1d(counts, RAIL_CYCLES, axis=0)
    cut: NDArray[np.bool_] = np.mean((usual > 255 - near) | (usual < near), axis=1) > MOST_ON_RAILS
    return cut if cut.mean() < 0.9 else np.zeros_like(cut)


def _lost(foot: FootRecording, t_s: Array) -> NDArray[np.bool_]:
    """(n, n_triangles) nothing new was read."""
    lost: NDArray[np.bool_] = foot.missing | foot.repeated[:, None]
    gap = np.diff(t_s, prepend=t_s[0])
    lost |= (gap > GAP_PERIODS * np.median(gap))[:, None]
    same = np.zeros((len(foot), len(foot.layout)), bool)
    pressure = foot.counts[:, :, PRESSURE_TAXELS]
    same[1:] = (pressure[1:] == pressure[:-1]).all(axis=2)
    same &= (foot.valid & PRESSURE_TAXELS).sum(axis=2) >= N_TAXELS / 2  # what stands at the end of its range may stay
    for row in range(len(foot.layout)):
        for a, b in stretches(same[:, row]):
            if b - a + 1 >= REPEATS:
                lost[a : b + 1, row] = True
    return lost


def _loud_boards(
    counts: Array, slots: NDArray[np.intp], boards: NDArray[np.uint8], t_s: Array
) -> list[tuple[NDArray[np.intp], tuple[tuple[float, float], ...]]]:
    """Taxels of boards that are loud for more than MOST_INVALID of the time, and when."""
    found = []
    level, window = _levels(counts[:, slots], t_s)
    if len(level) < 20:
        return []
    ratio = level / np.maximum(np.quantile(level, 0.1, axis=0), LEAST_COUNT)
    for board in np.unique(boards):
        own = boards[slots // N_TAXELS] == board
        loud = np.median(ratio[:, own], axis=1) > BOARD_LOUD if own.any() else np.zeros(len(level), bool)
        if loud.mean() > MOST_INVALID:
            found.append((slots[own], _joined(intervals(np.asarray(loud), t_s[::window]), 2 * WINDOW_S)))
    return found if len(found) < len(np.unique(boards)) else []  # all of them: it is the load's doing


def _levels(counts: Array, t_s: Array) -> tuple[Array, int]:
    """(windows, m) noise of each taxel in each WINDOW_S, and how many cycles that is."""
    window = max(round(WINDOW_S / float(np.median(np.diff(t_s)))), 4)
    n = len(t_s) // window
    third = np.abs(np.diff(counts, n=3, axis=0, prepend=counts[:3])) / np.sqrt(20.0)
    # Without the largest fifth: a snap is in a few differences of a window, noise is in all of them.
    sizes = np.sort(third[: n * window].reshape(n, window, -1), axis=1)[:, : round(0.8 * window)]
    return sizes.mean(axis=1) / _MEAN_OF_FOUR_FIFTHS, window


def _bursts(
    counts: Array, lost: NDArray[np.bool_], slots: NDArray[np.intp], t_s: Array
) -> tuple[NDArray[np.bool_], list[tuple[NDArray[np.intp], tuple[tuple[float, float], ...]]]]:
    """(n,) quiet cycles, and the taxels and times of bursts."""
    quiet = np.ones(len(t_s), bool)
    if not slots.size or len(t_s) < 100:
        return quiet, []
    level, window = _levels(counts[:, slots], t_s)
    loud = level > LOUD * noise_of_readings(counts[:, slots])
    n = len(level)
    gaps: NDArray[np.bool_] = np.any(lost[: n * window].reshape(n, window, -1), axis=1)
    loud &= ~gaps[:, slots // N_TAXELS]  # what is lost makes steps of its own
    # A step of the load is one loud window of all taxels; a burst lasts, or is some taxels' own.
    if not loud.any():
        return quiet, []
    taxels = np.flatnonzero(loud.sum(axis=0) * window * float(np.median(np.diff(t_s))) >= BURST_S)
    strong = loud[:, taxels]
    there = (strong.sum(axis=1) >= max(1, 0.5 * len(taxels))).astype(float)
    # A burst begins and ends within a window.
    times = np.repeat(np.convolve(there, np.ones(3), mode="same") > 0, window)
    flags = np.zeros(len(t_s), bool)
    flags[: len(times)] = times
    if not taxels.size or not flags.any() or flags.mean() > 0.5:
        return quiet, []
    quiet[flags] = False
    return quiet, [(slots[taxels], _joined(intervals(flags, t_s), WINDOW_S))]


def _joined(when: tuple[tuple[float, float], ...], gap_s: float) -> tuple[tuple[float, float], ...]:
    """Intervals closer than `gap_s` as one."""
    found: list[tuple[float, float]] = []
    for a, b in when:
        if found and a - found[-1][1] < gap_s:
            found[-1] = (found[-1][0], b)
        else:
            found.append((a, b))
    return tuple(found)
