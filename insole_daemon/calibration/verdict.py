"""Diagnose what is wrong with a taxel, and since when; its valid readings are fitted nevertheless.

| word | meaning |
|---|---|
| dead | never responded to a load |
| stuck | constant from some time on, or constant at a count far from no-load |
| loose | its triangle lost contact (all its taxels read as saturated) |
| saturating | reads the end of its range under load |
| noisy | one reading scatters by more than NOISY times the median of the insole |
| insensitive | responds with less than INSENSITIVE times the median of the insole |
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
_MIN_NOISE_COUNT = 1.5  # less noise is no fault, however quiet the other taxels are
_MIN_CONSTANT_S = 5.0
_DEAD_RANGE_COUNT = 1.0  # change of a dead taxel's count by the firmware's temperature compensation
_LOAD_RANGE_COUNT = 2.0  # range of the median taxel that shows a change of load
_NO_LOAD_TOLERANCE_COUNT = 40.0  # largest distance from its board's no-load count
_SATURATED = 0.005  # fraction of the cycles


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verdict on one taxel."""

    word: Word
    recording: str | None = None  # the first one that shows it
    since_s: float | None = None  # in that recording; None: from its start
    detail: str = ""


HEALTHY = Verdict("healthy")


def judge_taxels(samples: Sequence[Samples]) -> dict[int, Verdict]:
    """Return the verdict on every pressure taxel, by slot."""
    slots = np.flatnonzero(np.tile(PRESSURE_TAXELS, len(samples[0].trial.layout)))
    by_slot = dict.fromkeys(slots.tolist(), HEALTHY)
    # The order is by severity: a later verdict replaces an earlier one.
    for find in (_find_insensitive, _find_noisy, _find_saturating):
        by_slot.update(find(samples, slots))
    for trial_samples in samples:
        for slot, verdict in (*_find_loose(trial_samples.trial), *_find_constant(trial_samples.trial, slots)):
            if by_slot[slot].word not in ("loose", "stuck", "dead"):
                by_slot[slot] = verdict
    return by_slot


def judge_triangle(taxels: Sequence[Verdict]) -> Verdict:
    """Return the verdict that most of a triangle's ten pressure taxels share, else healthy with a detail."""
    words: list[str] = [verdict.word for verdict in taxels]
    bad = [verdict for verdict in taxels if verdict.word != "healthy"]
    for word in ("loose", "dead", "stuck", "saturating", "noisy", "insensitive"):
        if words.count(word) > len(words) / 2:
            first = next(verdict for verdict in bad if verdict.word == word)
            return Verdict(first.word, first.recording, first.since_s, f"{words.count(first.word)} of its taxels")
    return Verdict("healthy", detail=f"but for {len(bad)} of its taxels" if bad else "")


def _find_constant(trial: CalibrationTrial, slots: NDArray[np.intp]) -> list[tuple[int, Verdict]]:
    """Find dead and stuck taxels: constant to the end while the others changed."""
    counts = trial.counts[:, slots].astype(np.int16)
    level = np.median(counts, axis=1)
    last = np.median(counts[trial.t_s > trial.t_s[-1] - _MIN_CONSTANT_S], axis=0)
    constant = np.abs(counts - last) <= _DEAD_RANGE_COUNT
    # The first row after which a taxel is constant to the end.
    begins = len(counts) - np.argmin(constant[::-1], axis=0)
    begins[constant.all(axis=0)] = 0
    slot_verdicts = []
    no_load = {board.address: board.no_load for board in trial.foot.boards}
    for column in np.flatnonzero(
        trial.t_s[-1] - trial.t_s[np.minimum(begins, len(counts) - 1)] >= _MIN_CONSTANT_S
    ).tolist():
        slot, begin = int(slots[column]), int(begins[column])
        if float(np.ptp(level[begin:])) < _LOAD_RANGE_COUNT:
            continue  # no load changed in that time
        rests_at = no_load.get(trial.layout.triangles[slot // N_TAXELS].board)
        value = int(counts[-1, column])
        detail = f"reads {value} all the time"
        if begin == 0 and (rests_at is None or abs(value - rests_at) < _NO_LOAD_TOLERANCE_COUNT):
            slot_verdicts.append((slot, Verdict("dead", trial.name, None, detail)))
        else:
            slot_verdicts.append(
                (slot, Verdict("stuck", trial.name, float(trial.t_s[begin]) if begin else None, detail))
            )
    return slot_verdicts


def _find_loose(trial: CalibrationTrial) -> list[tuple[int, Verdict]]:
    """Find taxels of triangles that lost contact, from the detected faults."""
    rows = trial.layout.rows
    slot_verdicts = []
    for change in trial.faults:
        if change.began and change.kind == "triangle_loose" and change.triangle is not None:
            since_s = (change.t_ns - int(trial.foot.t_ns[0])) * 1e-9
            first = rows[change.board, change.triangle] * N_TAXELS
            slot_verdicts += [
                (first + int(taxel), Verdict("loose", trial.name, since_s, "with all of its triangle"))
                for taxel in np.flatnonzero(PRESSURE_TAXELS)
            ]
    return slot_verdicts


def _find_saturating(samples: Sequence[Samples], slots: NDArray[np.intp]) -> list[tuple[int, Verdict]]:
    """Find taxels that read 0 in too many cycles."""
    slot_verdicts = []
    for trial_samples in reversed(samples):  # the caller keeps the last verdict, so the earliest trial must come last
        is_at_end = (trial_samples.trial.counts[:, slots] == 0) & ~np.isclose(
            trial_samples.trial.rest_count[slots], 0.0
        )
        for column in np.flatnonzero(is_at_end.mean(axis=0) > _SATURATED).tolist():
            since_s = float(trial_samples.trial.t_s[int(np.argmax(is_at_end[:, column]))])
            detail = f"{is_at_end[:, column].mean():.1%} of the cycles"
            slot_verdicts.append((int(slots[column]), Verdict("saturating", trial_samples.trial.name, since_s, detail)))
    return slot_verdicts


def _find_noisy(samples: Sequence[Samples], slots: NDArray[np.intp]) -> list[tuple[int, Verdict]]:
    """Find noisy taxels by the change between successive cycles while the load changes slowly."""
    slot_verdicts = []
    for trial_samples in reversed(samples):
        changes = np.diff(trial_samples.trial.counts[:, slots].astype(np.int16), axis=0)
        # Cycles with less than the median change are mostly without movement, so walking does not count as noise.
        activity = np.abs(changes).mean(axis=1)
        noise = np.sqrt(np.mean(changes[activity <= np.median(activity)].astype(float) ** 2, axis=0) / 2)
        usual = float(np.median(noise))
        for column in np.flatnonzero(noise > max(NOISY * usual, _MIN_NOISE_COUNT)).tolist():
            detail = f"{noise[column]:.1f} counts, usual are {usual:.1f}"
            slot_verdicts.append((int(slots[column]), Verdict("noisy", trial_samples.trial.name, None, detail)))
    return slot_verdicts


def _find_insensitive(samples: Sequence[Samples], slots: NDArray[np.intp]) -> list[tuple[int, Verdict]]:
    """Find insensitive taxels in chamber trials, since only there is the load on every taxel known."""
    slot_verdicts = []
    for trial_samples in samples:
        if trial_samples.trial.kind != "chamber" or not len(trial_samples.t_s):
            continue
        pressure = trial_samples.reference[:, 0]
        top = pressure > 0.8 * pressure.max()
        response = np.median(trial_samples.activation[top][:, slots], axis=0)
        usual = float(np.median(response))
        for column in np.flatnonzero(response < INSENSITIVE * usual).tolist():
            detail = f"{response[column]:.1f} counts where {usual:.1f} are usual"
            slot_verdicts.append((int(slots[column]), Verdict("insensitive", trial_samples.trial.name, None, detail)))
    return slot_verdicts
