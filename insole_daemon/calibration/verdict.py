"""What is wrong with a taxel, and since when; the good part of what it read is fitted all the same.

| word | means |
|---|---|
| dead | never answered to a load |
| stuck | stands still, or stands where nothing rests |
| loose | its triangle lost contact (all of it read as saturated) |
| saturating | reads the end of its range under load |
| noisy | one reading scatters by more than NOISY times what is usual on this insole |
| insensitive | answers with less than a part INSENSITIVE of what is usual on this insole |
| healthy | none of these |
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..skin.geometry import N_TAXELS, PRESSURE_TAXELS
from .samples import Samples
from .trials import CalibrationTrial

Array = NDArray[np.float64]

Word = Literal["dead", "stuck", "loose", "saturating", "noisy", "insensitive", "healthy"]

NOISY = 2.5
INSENSITIVE = 1 / 3
_QUIET_COUNT = 1.5  # less noise than that is no fault, however quiet the others are
_STILL_S = 5.0
_FLICKERS_COUNT = 1.0  # what the firmware's compensation may move a taxel by that is dead
_MOVES_COUNT = 2.0  # of the mean of all taxels: then a load changes
_RESTS_COUNT = 40.0  # from what its board rests at
_SATURATED = 0.005  # of the cycles


@dataclass(frozen=True, slots=True)
class Verdict:
    """On one taxel."""

    word: Word
    recording: str | None = None  # in which it was seen first
    since_s: float | None = None  # in that recording; None: from its start
    detail: str = ""


HEALTHY = Verdict("healthy")


def verdicts(samples: Sequence[Samples]) -> dict[int, Verdict]:
    """By slot, of all pressure taxels."""
    slots = np.flatnonzero(np.tile(PRESSURE_TAXELS, len(samples[0].trial.layout)))
    found = dict.fromkeys(slots.tolist(), HEALTHY)
    # The later ones are the graver ones, and take the place of the others.
    for each in (*_insensitive(samples, slots), *_noisy(samples, slots), *_saturating(samples, slots)):
        found[each[0]] = each[1]
    for one in samples:
        for slot, verdict in (*_loose(one.trial), *_still(one.trial, slots)):
            if found[slot].word not in ("loose", "stuck", "dead"):
                found[slot] = verdict
    return found


def of_triangle(taxels: Sequence[Verdict]) -> Verdict:
    """What its ten pressure taxels share; healthy where most are, with how many are not."""
    words: list[str] = [each.word for each in taxels]
    bad = [each for each in taxels if each.word != "healthy"]
    for word in ("loose", "dead", "stuck", "saturating", "noisy", "insensitive"):
        if words.count(word) > len(words) / 2:
            first = next(each for each in bad if each.word == word)
            return Verdict(first.word, first.recording, first.since_s, f"{words.count(first.word)} of its taxels")
    return Verdict("healthy", detail=f"but for {len(bad)} of its taxels" if bad else "")


def _still(trial: CalibrationTrial, slots: NDArray[np.intp]) -> list[tuple[int, Verdict]]:
    """Dead and stuck ones: constant to the end while the others moved."""
    counts = trial.counts[:, slots].astype(np.int16)
    level = np.median(counts, axis=1)
    last = np.median(counts[trial.t_s > trial.t_s[-1] - _STILL_S], axis=0)
    constant = np.abs(counts - last) <= _FLICKERS_COUNT
    # The first row from which on a taxel says the same to the end.
    begins = len(counts) - np.argmin(constant[::-1], axis=0)
    begins[constant.all(axis=0)] = 0
    found = []
    no_load = {board.address: board.no_load for board in trial.foot.boards}
    for at in np.flatnonzero(trial.t_s[-1] - trial.t_s[np.minimum(begins, len(counts) - 1)] >= _STILL_S).tolist():
        slot, begin = int(slots[at]), int(begins[at])
        if float(np.ptp(level[begin:])) < _MOVES_COUNT:
            continue  # nothing pressed on anything then
        rests_at = no_load.get(trial.layout.triangles[slot // N_TAXELS].board)
        value = int(counts[-1, at])
        said = f"reads {value} all the time"
        if begin == 0 and (rests_at is None or abs(value - rests_at) < _RESTS_COUNT):
            found.append((slot, Verdict("dead", trial.name, None, said)))
        else:
            found.append((slot, Verdict("stuck", trial.name, float(trial.t_s[begin]) if begin else None, said)))
    return found


def _loose(trial: CalibrationTrial) -> list[tuple[int, Verdict]]:
    rows = trial.layout.rows
    found = []
    for change in trial.faults:
        if change.began and change.kind == "triangle_loose" and change.triangle is not None:
            since_s = (change.t_ns - int(trial.foot.t_ns[0])) * 1e-9
            first = rows[change.board, change.triangle] * N_TAXELS
            found += [
                (first + int(taxel), Verdict("loose", trial.name, since_s, "with all of its triangle"))
                for taxel in np.flatnonzero(PRESSURE_TAXELS)
            ]
    return found


def _saturating(samples: Sequence[Samples], slots: NDArray[np.intp]) -> list[tuple[int, Verdict]]:
    found = []
    for one in reversed(samples):  # the earliest is the last that counts
        ends = (one.trial.counts[:, slots] == 0) & ~np.isclose(one.trial.rest_count[slots], 0.0)
        for at in np.flatnonzero(ends.mean(axis=0) > _SATURATED).tolist():
            since_s = float(one.trial.t_s[int(np.argmax(ends[:, at]))])
            said = f"{ends[:, at].mean():.1%} of the cycles"
            found.append((int(slots[at]), Verdict("saturating", one.trial.name, since_s, said)))
    return found


def _noisy(samples: Sequence[Samples], slots: NDArray[np.intp]) -> list[tuple[int, Verdict]]:
    """By what differs from one cycle to the next, while the load changes slowly."""
    found = []
    for one in reversed(samples):
        steps = np.diff(one.trial.counts[:, slots].astype(np.int16), axis=0)
        # Of those below the median step of all, most rest or move slowly; walking does not make noise.
        busy = np.abs(steps).mean(axis=1)
        noise = np.sqrt(np.mean(steps[busy <= np.median(busy)].astype(float) ** 2, axis=0) / 2)
        usual = float(np.median(noise))
        for at in np.flatnonzero(noise > max(NOISY * usual, _QUIET_COUNT)).tolist():
            said = f"{noise[at]:.1f} counts, usual are {usual:.1f}"
            found.append((int(slots[at]), Verdict("noisy", one.trial.name, None, said)))
    return found


def _insensitive(samples: Sequence[Samples], slots: NDArray[np.intp]) -> list[tuple[int, Verdict]]:
    """Told in a chamber alone: there the load on every taxel is known."""
    found = []
    for one in samples:
        if one.trial.kind != "chamber" or not len(one.t_s):
            continue
        pressure = one.reference[:, 0]
        top = pressure > 0.8 * pressure.max()
        answer = np.median(one.activation[top][:, slots], axis=0)
        usual = float(np.median(answer))
        for at in np.flatnonzero(answer < INSENSITIVE * usual).tolist():
            said = f"{answer[at]:.1f} counts where {usual:.1f} are usual"
            found.append((int(slots[at]), Verdict("insensitive", one.trial.name, None, said)))
    return found
