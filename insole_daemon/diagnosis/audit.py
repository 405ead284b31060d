"""What is wrong with the readings themselves, before any physics: masked from the fit, and reported.

Everything is told from the counts and the cycles' own flags. The mean of the insole's readings stands for the load
here: the reference's clock is not known yet.

What is masked is readings, not taxels: one that stood at an end of its range for a while, or whose triangle had lost
contact, is believed elsewhere.
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
from .floor import noise_of_readings
from .lost import gaps, not_new
from .loudness import bursts, intervals, joined, loud_boards
from .observed import stretches
from .places import said, where

SAME_S = 4.0  # a working taxel does not say one number for so long while the load moves
TALKS = 0.25  # as often as the liveliest taxels do: one that changes more seldom tells little of the load
MOVED = 0.15  # of the insole's range: the load moved
MOST_DEAD = 0.3  # of its cycles without a reading that can be believed: the taxel is called dead
LEAST_BELIEVED = 0.5  # of its cycles in which it works and is within its range: less, and it is left out
LEAST_TAXELS = 0.5  # of the taxels that are believed: less, and a cycle is left out
RAIL_SIGMAS, RAIL_CYCLES, MOST_ON_RAILS = 2.5, 15, 0.2  # how near an end, over how many cycles, how many taxels
OPEN_S = 0.3  # how long a triangle is silent before it is called open
ALWAYS = 0.95  # of the time: from beginning to end
OPEN_TAXELS = 8  # of a triangle's ten that fail together: the triangle has lost contact
# Further than the other taxels from one cycle to the next, and how often: a loose contact.
LEAP_COUNT, LEAPS = 45.0, 2
MOST_LEAPING = 0.5  # of the taxels: as many loose contacts there are not
MOVES_S, MOVES = 0.2, 0.02  # before and after a leap, by what part of the insole's range the load moves
MOST_LOST = 0.003  # of all cycles: fewer are what a bus loses
FROZEN = 0.9  # of the cycles without a new reading: the triangle is not there, whatever it says


@dataclass(frozen=True, slots=True, eq=False)
class Audit:
    """Which readings are fit to be explained, and what was found out about the others."""

    kept: NDArray[np.bool_]  # (n_triangles, 12)
    believed: NDArray[np.bool_]  # (n, n_triangles, 12) readings
    cycles: NDArray[np.bool_]  # (n,) that say enough: where steps are walked, something new of every triangle
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
    old = not_new(foot)
    believed = valid & ~np.repeat(old, N_TAXELS, axis=1)
    dead = np.zeros((n, k * N_TAXELS), bool)
    dead[:, asked] = _dead(counts[:, asked], valid[:, asked], t_s, mean)
    frozen = old.mean(axis=0) > FROZEN
    if not frozen.all():  # else the load never moved
        dead[:, asked] |= frozen[asked // N_TAXELS]
    believed &= ~dead
    # Where many stand at an end of their range together it is the rest counts that have wandered off, not the taxels.
    railed = _on_rails(counts[:, asked])
    findings: list[Finding] = []
    boards = foot.layout.identities[:, 0]
    loud = np.zeros(k * N_TAXELS, bool)
    gone = np.zeros_like(loud)
    gone[asked] = dead[~railed][:, asked].mean(axis=0) > MOST_DEAD
    # Readings at the upper end are a rest count that has wandered off, not a line without a triangle.
    silent_now = (dead & (counts < 255)).reshape(n, k, N_TAXELS)
    opened = _open(silent_now, t_s)
    apart: dict[tuple[tuple[float, float], ...], list[int]] = {}
    for row in opened:
        slots = row * N_TAXELS + np.flatnonzero(PRESSURE_TAXELS)
        if gone[slots].sum() >= OPEN_TAXELS:  # what its last taxels say is not to be believed either
            gone[slots] = True
        silent_together = np.asarray(silent_now[:, row].sum(axis=1) >= OPEN_TAXELS)
        when = joined(intervals(silent_together, t_s), 1.0) if silent_together.mean() < ALWAYS else ()
        apart.setdefault(when, []).append(row)
    for when, rows_of in apart.items():
        text = "lost contact: " + ("its taxels fail" if len(rows_of) == 1 else "the taxels of each fail") + " together"
        place = Where("triangle", tuple(tuple(identity) for identity in foot.layout.identities[rows_of].tolist()))
        findings.append(_finding("open_triangle", foot, name, place, when, text + ("" if when else ", all along")))
    working = asked[~gone[asked]]
    for own, when in (
        () if steps else loud_boards(counts[:, working], believed[:, working], boards[working // N_TAXELS], t_s)
    ):
        loud[working[own]] = True
        text = "is far noisier in some stretches than in others, too long to leave them out: the board is left out"
        findings.append(_finding("noise_burst", foot, name, working[own], when, text))
    leaping = _loose(counts[:, asked], valid[:, asked], mean, t_s, steps)
    if leaping.mean() < MOST_LEAPING:  # else it is how this insole answers, and no contact
        gone[asked] |= ~loud[asked] & leaping
    lone = np.array([slot for slot in np.flatnonzero(gone) if slot // N_TAXELS not in opened], np.intp)
    if lone.size:
        when = intervals(np.asarray(dead[:, lone].any(axis=1)), t_s)
        always = dead[:, lone].mean() > ALWAYS
        text = "say the same number while the load moves, leap, or say none that can be believed"
        findings.append(_finding("dead_taxels", foot, name, lone, () if always else when, text))
    unfit = gone.copy()
    unfit[asked] |= (valid & ~dead)[~railed][:, asked].mean(axis=0) < LEAST_BELIEVED
    # What a triangle without a taxel to believe lacks is no cycle's loss: one that is not there says the same for ever.
    there = (~unfit.reshape(k, N_TAXELS) & _asked(foot)).any(axis=1)
    lost = (old | gaps(t_s)[:, None]) & there
    fresh: NDArray[np.bool_] = ~np.any(lost, axis=1)
    bad = unfit | loud
    if not steps:
        quiet_of = asked[~bad[asked]]
        noisy, flags, when = bursts(counts[:, quiet_of], believed[:, quiet_of], t_s)
        if when:
            believed[np.ix_(flags, quiet_of[noisy])] = False
            text = "far noisier than usual for a while"
            findings.append(_finding("noise_burst", foot, name, quiet_of[noisy], when, text))
    if (~fresh).mean() > MOST_LOST:
        rows = np.flatnonzero(lost.mean(axis=0) > MOST_LOST)
        slots = (rows[:, None] * N_TAXELS + np.flatnonzero(PRESSURE_TAXELS)).ravel()
        when = joined(intervals(~fresh, t_s), 1.0)
        spread = sum(b - a for a, b in when) > 0.5 * t_s[-1] or len(when) > 40
        text = f"{lost[:, rows].mean():.1%} of the readings did not come, or came again unchanged"
        findings.append(_finding("frame_loss", foot, name, slots, () if spread else when, text))
    kept = ~bad.reshape(k, N_TAXELS) & _asked(foot)
    of_kept = kept.ravel()
    enough = fresh if steps or not of_kept.any() else believed[:, of_kept].mean(axis=1) >= LEAST_TAXELS
    cycles = enough & ~_on_rails(counts[:, of_kept])
    return Audit(kept, believed.reshape(n, k, N_TAXELS), cycles, tuple(findings))


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
    """(n, m) not to be believed, or one number for long while the load moved, and not for the load's sake."""
    dead = ~valid
    for i in range(counts.shape[1]):
        change = np.flatnonzero(np.diff(counts[:, i]) != 0)
        starts, ends = np.append(0, change + 1), np.append(change, len(t_s) - 1)
        for a, b in zip(starts[t_s[ends] - t_s[starts] > SAME_S], ends[t_s[ends] - t_s[starts] > SAME_S], strict=True):
            if np.ptp(mean[a : b + 1]) > MOVED:
                dead[a : b + 1, i] = True
        dead[_beyond(counts[:, i], mean), i] = False
    return dead


def _beyond(count: Array, mean: Array) -> NDArray[np.bool_]:
    """(n,) cycles in which a taxel stands at an end of its range because the load, or its rest count, is beyond it.

    It comes there and leaves step by step, where a line that breaks gets there in one leap, and is at 0 while the
    insole bears more than else, `mean` (n,) of its range, and at 255 while it bears less.
    """
    found = np.zeros(len(count), bool)
    for end, sign in ((0, 1), (255, -1)):
        there = np.zeros(len(count), bool)
        for a, b in stretches(count == end):
            sides = [count[row] for row in (a - 1, b + 1) if 0 <= row < len(count)]
            there[a : b + 1] = bool(sides) and all(abs(side - end) <= LEAP_COUNT for side in sides)
        if there.any() and not there.all() and sign * (np.median(mean[there]) - np.median(mean[~there])) > 0:
            found |= there
    return found


def _loose(counts: Array, valid: NDArray[np.bool_], mean: Array, t_s: Array, steps: bool) -> NDArray[np.bool_]:
    """(m,) taxels that leapt alone from one cycle to the next, several times, and half of the time not with the load.

    What snaps leaps as well, but down in counts while it is loaded, and up while it is unloaded. Where a heel strikes,
    some taxels leap and the others do not; but then they bear that load for a while: of `steps` only what leaps back at
    once counts.
    """
    change = np.diff(counts, axis=0)
    change -= np.median(change, axis=1, keepdims=True)
    leaps = (np.abs(change) > LEAP_COUNT) & valid[1:] & valid[:-1]
    if steps:
        leaps[1:] &= leaps[:-1] & (change[1:] * change[:-1] < 0)
        leaps[0] = False
    side = max(round(MOVES_S / float(np.median(np.diff(t_s)))), 1)
    rows = np.arange(len(change))
    went = mean[np.minimum(rows + 1 + side, len(mean) - 1)] - mean[np.maximum(rows - side, 0)]
    along = leaps & (change * went[:, None] < 0) & (np.abs(went) > MOVES)[:, None]
    found: NDArray[np.bool_] = (leaps.sum(axis=0) >= LEAPS) & (2 * along.sum(axis=0) <= leaps.sum(axis=0))
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
