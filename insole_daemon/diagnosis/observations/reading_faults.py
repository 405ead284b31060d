"""Faults that readings show by themselves: lost contact, dead taxels, lost or repeated frames, bursts of noise, spikes.

What a fault spoils is not deleted: its triangle is stood in for by others, and its rows weigh less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter, percentile_filter

from ...physics.effect import Where
from ...physics.law import Array
from ...recording.loading import FootRecording
from ..audit import audit
from ..contact import joined
from ..finding import Finding
from ..places import said
from .hidden_faults import never_has, pick_up, stuck_bit, together
from .paired import PairedObservation
from .rezeros import with_rezeros
from .shifted_boards import with_shifts
from .taxel_faults import with_taxels
from .wrench import FINE_S, LARGEST, WrenchObservation

TAKEN = ("open_triangle", "dead_taxels")  # of the audit of readings
MOST_GOOD = 0.95  # of the readings that came while a triangle is called open: more, and it has only lost readings
MOST_LOST = 0.003  # of a triangle's readings: what a bus loses without a fault
LEAST_REPEATED = 0.005  # share of repeats that frames lost on the way make
BURST_TIMES, CALM_QUANTILE = 2.0, 0.25  # a window's noise against the triangle's usual one; rows in the air
MOST_CALM, LEAST_CALM = 0.35, 4  # of all rows, those in which the load changes least; of them in a window, for a level
USUAL_QUANTILE = 0.3  # of the windows: what scatters for more than half of the time does not do so usually
LEAST_COUNT = 0.5  # of noise: of a reading that toggles between two counts, the most that rounding alone makes
WINDOW_S, LEAST_BURST_S, MOST_BURST = 1.5, 2.9, 0.75
SPIKE_SIGMAS, LEAST_SPIKES, LEAST_LEAPS = 9.0, 4, 3  # leaps: that no pressure could have
LEAP_ROWS = 3  # of the reference, that it is away for at the most
NEAR_S = 0.1  # readings and reference may be apart by as much
MOST_RESTING_COUNT = 30.0  # of activation that a shift of the baseline can hide
LEAST_WORKING = 3  # taxels of a triangle, whose mean stands in for its others
DONORS = 3  # triangles nearby, that stand in for one that hardly works
APART_S = 1.0  # of two times that are told as one
MOST_SILENT = 0.5  # of a window's readings, that are cut off


@dataclass(frozen=True, slots=True, eq=False)
class ReadingFaults:
    """What was found, and the observation with it taken into account."""

    observation: WrenchObservation
    substituted: NDArray[np.bool_]  # (T,) triangles with taxels that others, or others' curves, stand in for
    findings: tuple[Finding, ...]
    spikes: NDArray[np.bool_]  # (N,) rows in which the reference leaps
    explained: Array  # (1,) count² or (3,) N² and N²·m²: mean square error that was put right before the regression


def reading_faults(foot: FootRecording, seen: WrenchObservation) -> ReadingFaults:
    """Faults of the readings of `foot`, as `seen` on its grid."""
    audited = audit(foot, seen.name, steps=not seen.is_uniform)
    findings = [each for each in audited.findings if each.effect in TAKEN and not _did_not_come(each, seen)]
    findings = [each for each in (_without_resting(each, seen) for each in findings) if each is not None]
    seen, rezeroed = with_rezeros(foot, seen)
    as_read = seen
    if not seen.load_is_known:
        seen = seen.with_unloaded()
    pull = np.zeros(1) if seen is as_read else np.maximum(as_read.square_error - seen.square_error, 0.0)
    boards = {each.where.ids[0][0] for each in rezeroed}
    # A board that was zeroed under load reads as if nothing were connected until there is more.
    findings = [each for each in findings if each.effect != "open_triangle" or each.where.ids[0][0] not in boards]
    broken = np.zeros_like(seen.usable)
    for each in findings:
        broken.reshape(-1)[each.where.slots(seen.layout)] = True
    stuck = _stuck(seen)
    for each in stuck:
        broken.reshape(-1)[each.where.slots(seen.layout)] = True
    broken &= seen.usable
    findings += stuck
    is_estimated = np.zeros(len(broken), bool) if seen.is_estimated is None else seen.is_estimated
    working = seen.usable & ~broken & ~is_estimated[:, None]
    substituted = np.asarray(broken.any(axis=1))
    seen = _substitute(seen, working, substituted) if substituted.any() else seen
    findings += rezeroed
    as_believed = seen
    seen, shifted = with_shifts(foot, seen, working)
    findings += shifted
    seen, odd = with_taxels(seen, working)
    findings += odd
    findings += _lost(foot, seen, substituted)
    loudness, bursts = _bursts(seen)
    findings += bursts
    swings, swinging = _pick_up(seen)
    findings += swinging
    seen = replace(seen, loudness=np.maximum(loudness, swings))
    spikes, spiked = _spikes(seen)
    findings += spiked
    explained = np.zeros(1 if seen.load_is_known else 3)
    explained[0] = sum(each.explains for each in findings)
    if shifted and not seen.load_is_known:
        explained[1:] = np.maximum(as_believed.square_error - seen.square_error, 0.0)[1:]
    return ReadingFaults(seen, substituted | is_estimated, tuple(findings), spikes, explained + pull)


def _stuck(seen: WrenchObservation) -> list[Finding]:
    """Triangles in whose counts a bit never changes."""
    bits = [stuck_bit(own, usable) for own, usable in zip(seen.readings, seen.usable, strict=True)]
    found = []
    for bit in sorted({bit for bit in bits if bit is not None}):
        rows = [row for row, own in enumerate(bits) if own == bit]
        rows = _and_boards(seen, rows, bit)
        text = f"bit {bit} of the counts never changes, although they pass both of its values: look at the digitiser"
        found.append(_finding(seen, "unknown", _triangles(seen, rows), (), text))
    return found


def _and_boards(seen: WrenchObservation, rows: Sequence[int], bit: int) -> list[int]:
    """`rows`, and all of a board of which several triangles are among them and none has another value of the bit."""
    found, boards = set(rows), seen.layout.identities[:, 0]
    for board in np.unique(boards[list(rows)]).tolist():
        own = np.flatnonzero((boards == board) & seen.usable.any(axis=1)).tolist()
        if len(found & set(own)) > 1 and all(
            row in found or never_has(seen.readings[row], seen.usable[row], bit) for row in own
        ):
            found |= set(own)
    return sorted(found)


def _pick_up(seen: WrenchObservation) -> tuple[Array, list[Finding]]:
    """(T,) how many times as loud triangles are whose taxels swing at once, and what is said of them."""
    shares = np.array([together(own, usable) for own, usable in zip(seen.readings, seen.usable, strict=True)])
    swings = pick_up(shares)
    if not swings.any():
        return np.ones(len(shares)), []
    text = "all taxels swing at once, faster than the load: pick-up of the mains or of a motor, folded by the sampling"
    where = _triangles(seen, np.flatnonzero(swings).tolist())
    return np.where(swings, np.sqrt(np.where(swings, shares, 1.0)), 1.0), [_finding(seen, "unknown", where, (), text)]


def _without_resting(each: Finding, seen: WrenchObservation) -> Finding | None:
    """Without taxels that stay at the unloaded end of their range where there is hardly a load: a shift does that."""
    if each.effect != "dead_taxels" or not seen.load_is_known or each.where.scope != "taxel":
        return each
    slots = np.asarray(each.where.slots(seen.layout))
    count = (seen.calibration.baseline_count - seen.activation_count).reshape(len(seen.t_s), -1)[:, slots]
    most = np.quantile(seen.expected_count.reshape(len(seen.t_s), -1)[:, slots], 0.99, axis=0)
    resting = (np.quantile(count, 0.01, axis=0) > LARGEST) & (most < MOST_RESTING_COUNT)
    if not resting.any():
        return each
    kept = tuple(one for one, rests in zip(each.where.ids, resting.tolist(), strict=True) if not rests)
    return replace(each, where=Where("taxel", kept)) if kept else None


def _did_not_come(each: Finding, seen: WrenchObservation) -> bool:
    """Whether a triangle said to be open has only lost readings: those that came meanwhile are good."""
    if each.effect != "open_triangle" or not each.when_s:
        return False
    identities = [tuple(identity) for identity in seen.layout.identities.tolist()]
    good: list[float] = []
    for row in (identities.index(identity[:2]) for identity in each.where.ids):
        own = seen.readings[row]
        during = np.any([(own.t_s >= a) & (own.t_s <= b) for a, b in each.when_s], axis=0)
        good += own.valid[during][:, seen.usable[row]].ravel().tolist()
    return not good or float(np.mean(good)) > MOST_GOOD


def _substitute(
    seen: WrenchObservation, working: NDArray[np.bool_], substituted: NDArray[np.bool_]
) -> WrenchObservation:
    """`seen` with the mean of working taxels nearby in the place of those that do not work."""
    activation, stood_in = seen.activation_count.copy(), np.zeros(len(substituted), bool)
    for row in np.flatnonzero(substituted).tolist():
        donors = [j for j in seen.nearest(row) if working[j].any()]
        stood_in[row] = working[row].sum() < LEAST_WORKING
        donors = [j for j in donors if j != row][:DONORS] if stood_in[row] else [row]
        mean = np.mean([activation[:, j][:, working[j]].mean(axis=1) for j in donors], axis=0)
        activation[:, row][:, seen.usable[row] & ~working[row]] = mean[:, None]
    return replace(seen, activation_count=activation, stood_in=stood_in)


def _finding(
    seen: WrenchObservation, effect: str, where: Where, when: Sequence[tuple[float, float]], text: str
) -> Finding:
    return Finding(
        effect=effect, foot=seen.layout.foot, where=where, sentence=f"{said(where)}: {text}.",
        recordings=(seen.name,), when_s=tuple(when),
    )  # fmt: skip


def _lost(foot: FootRecording, seen: WrenchObservation, substituted: NDArray[np.bool_]) -> list[Finding]:
    """Triangles whose readings did not come, or came again."""
    rows, shares = [], []
    times: list[tuple[float, float]] = []
    for row, each in enumerate(seen.readings):
        if len(each.t_s) < 50 or substituted[row]:
            continue
        steps = np.diff(each.t_s)
        missing = np.maximum(np.rint(steps / each.period_s) - 1, 0)
        share = float(missing.sum() / (len(steps) + missing.sum()))
        repeats = each.held_fraction if each.held_fraction > LEAST_REPEATED and not each.is_converter_slow else 0.0
        if max(share, repeats) > MOST_LOST:
            rows.append(row)
            shares.append(max(share, repeats))
            if not times:
                times = [(float(each.t_s[k]), float(each.t_s[k + 1])) for k in np.flatnonzero(missing)]
    if not rows:
        return []
    where = _triangles(seen, rows)
    spread = len(times) > 40 or sum(b - a for a, b in times) > 0.5 * float(np.ptp(seen.t_s))
    text = f"{np.mean(shares):.1%} of the readings did not come, or came again unchanged"
    return [_finding(seen, "frame_loss", where, () if spread else joined(times, APART_S), text)]


def _triangles(seen: WrenchObservation, rows: Sequence[int]) -> Where:
    """The coarsest place that is these triangles."""
    identities = [tuple(identity) for identity in seen.layout.identities.tolist()]
    if len(rows) >= 0.9 * len(identities):
        return Where()
    boards = sorted({identities[row][0] for row in rows})
    of_boards = [row for row, identity in enumerate(identities) if identity[0] in boards]
    if len(rows) >= 0.9 * len(of_boards):
        return Where("board", tuple((board,) for board in boards))
    return Where("triangle", tuple(identities[row] for row in rows))


def _bursts(seen: WrenchObservation) -> tuple[Array, list[Finding]]:
    """(N, T) how many times as large as usual the noise of a triangle's readings is, and what is said of it."""
    loudness = np.ones(seen.missing.shape)
    size = max(round(WINDOW_S / seen.step_s), 8)
    n = len(seen.t_s) // size
    if n < 8:
        return loudness, []
    third = np.zeros_like(seen.activation_count)
    third[1:-2] = np.diff(seen.activation_count, n=3, axis=0) / np.sqrt(20.0)
    taxels = np.maximum(seen.usable.sum(axis=1), 1)
    course = np.sqrt(np.sum(third**2 * seen.usable, axis=2) / taxels)
    level = _calm_level(seen, third, course, n, size)
    # Readings that are cut off do not scatter: what then scatters as usual would pass for a burst.
    silent = (seen.clipped | seen.missing)[: n * size].reshape(n, size, -1).mean(axis=1) > MOST_SILENT
    heard = np.where(silent, np.nan, level)
    usual = np.where(silent.all(axis=0), np.inf, np.maximum(_usual(heard), LEAST_COUNT))
    level = np.where(silent, 0.0, level)
    loud = level > BURST_TIMES * usual
    loud &= median_filter(loud.astype(np.uint8), (3, 1), mode="nearest") > 0
    share = loud.mean(axis=0)
    bursting = (share * n * size * seen.step_s >= LEAST_BURST_S) & (share < MOST_BURST)
    loud &= bursting
    ratio = np.where(loud, level / usual, 1.0)
    loudness[: n * size] = np.repeat(ratio, size, axis=0)
    # A burst begins and ends within a window.
    loudness = maximum_filter1d(loudness, 2 * (size // 2) + 1, axis=0)
    if not bursting.any():
        return loudness, []
    edges = np.flatnonzero(np.diff(loud.any(axis=1).astype(int), prepend=0, append=0)).reshape(-1, 2)
    when = [(float(seen.t_s[a * size]), float(seen.t_s[min(b * size, len(seen.t_s) - 1)])) for a, b in edges]
    text = f"readings scatter {np.median(ratio[loud]):.1f} times as much as usual for a while"
    where = _triangles(seen, np.flatnonzero(bursting).tolist())
    return loudness, [_finding(seen, "noise_burst", where, when, text)]


def _calm_level(seen: WrenchObservation, third: Array, course: Array, n: int, size: int) -> Array:
    """(n, T) level of `course` (N, T) in n windows of `size` rows, in rows in which the load is calm.

    Where most triangles hardly move, one that scatters is noisy; in a window with few such rows, a low quantile of
    all: an edge of the load is a few rows, a burst is all of them.
    """
    taxels = np.maximum(seen.usable.sum(axis=1), 1)
    moves = np.median(np.abs(np.sum(third * seen.usable, axis=2)) / taxels, axis=1)
    calm = (moves <= np.quantile(moves, MOST_CALM))[: n * size].reshape(n, size)
    windows = course[: n * size].reshape(n, size, -1)
    level = np.quantile(windows, CALM_QUANTILE, axis=1)
    for k in np.flatnonzero(calm.sum(axis=1) >= LEAST_CALM):
        level[k] = np.median(windows[k, calm[k]], axis=0)
    return np.asarray(level)


def _usual(values: Array) -> Array:
    """(m,) low level of the columns of (n, m), NaN left out; 0: there is nothing else."""
    there = np.isfinite(values)
    return np.array(
        [
            np.quantile(own[yes], USUAL_QUANTILE) if yes.any() else 0.0
            for own, yes in zip(values.T, there.T, strict=True)
        ]
    )


def _leapt(seen: WrenchObservation) -> list[Finding]:
    """What is said of a reference whose leaps have been left out."""
    when = [tuple((each - seen.offset_s) / (1.0 + seen.rate) for each in leap) for leap in seen.reference.leaps_s]
    if len(when) < LEAST_LEAPS:
        return []
    text = f"the reference leaps for a moment, {len(when)} times"
    return [_finding(seen, "reference_fault", Where(), joined([(a, b) for a, b in when], APART_S)[:40], text)]


def _spikes(seen: WrenchObservation) -> tuple[NDArray[np.bool_], list[Finding]]:
    """(N,) rows in which the reference leaps and the insole does not, and what is said of them.

    A leap is a few rows of the reference that its own neighbours do not foretell, far more than they are off by
    themselves; a heel that strikes is known to the insole, too.
    """
    if isinstance(seen, PairedObservation):
        return np.zeros(len(seen.t_s), bool), []  # a simulation does not leap
    if seen.load_is_known:
        return np.zeros(len(seen.t_s), bool), _leapt(seen)
    width = max(round(LEAP_ROWS * seen.reference.row_s / FINE_S), 1) * 2 + 1
    fine = seen.reference.fine
    leaps = np.abs(fine - median_filter(fine, (width, 1), mode="nearest"))
    usual = percentile_filter(leaps, 90, (4 * width + round(0.5 / FINE_S) | 1, 1))
    leaping = (leaps > SPIKE_SIGMAS * seen.reference.noise) & (leaps > 4.0 * usual)
    # What strikes the insole, too, about the same time is a heel, whatever the clock, a delay or a lag make of it.
    rows = max(round(NEAR_S / seen.step_s), 2)
    struck = np.ptp(sliding_window_view(np.pad(seen.wrench, ((rows, rows), (0, 0)), "edge"), 2 * rows + 1, 0), axis=-1)
    of_row = np.clip(np.rint(seen.reference_s / FINE_S), 0, len(fine) - 1).astype(np.intp)
    steps = max(round(seen.step_s / FINE_S), 1)
    size = maximum_filter1d(np.where(leaping, leaps, 0.0), steps, axis=0)[of_row]
    left = np.abs(seen.reference.at(seen.reference_s) - seen.wrench)
    alone = np.sort(np.stack([np.roll(left, k, axis=0) for k in (-3, -2, 2, 3)]), axis=0)[2]
    spikes = np.any((size > struck) & (size > 2.0 * alone), axis=1)
    starts = int((np.diff(spikes.astype(int), prepend=0) == 1).sum())
    if starts < LEAST_SPIKES:
        return np.zeros(len(spikes), bool), []
    when = [(float(t), float(t + seen.step_s)) for t in seen.t_s[spikes]]
    text = f"the reference leaps for a moment, {starts} times"
    return spikes, [_finding(seen, "reference_fault", Where(), joined(when, APART_S)[:40], text)]
