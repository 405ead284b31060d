"""One foot of a recording, made ready to be fitted or judged: activations, what of them may be used, the reference.

Every trial is zeroed on its own start: the activation is what a taxel read while nothing pressed, less what it reads.
What is masked, and since when, is what the daemon's own watch of faults finds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..config import Foot, Publish
from ..errors import CalibrationError
from ..recording.loading import FootRecording, Recording, as_configured
from ..recording.read_times import arrived, at_cycles
from ..skin.cycles import Cycles
from ..skin.faults import FaultWatch
from ..skin.faults.watch import Change
from ..skin.geometry import N_TAXELS
from ..skin.layout import Layout
from ..skin.validity import Validity
from .references import Readings, checked_readings

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEAST_REST_S = 0.5
_MOST_REST_S = 30.0
_STARTS_COUNT = 0.3  # of the insole's mean: what it has changed by when the load has begun
_SETTLES_S = 0.1  # left out before the load's begin


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationTrial:
    """n cycles of one foot beside its reference; slots are the layout's triangles times 12."""

    name: str
    kind: Literal["chamber", "shoe"]
    foot: FootRecording
    t_s: Array  # (n,) since the first cycle
    rest_count: Array  # (slots,) without load, before anything presses
    noise_count: Array  # (slots,) standard deviation of one reading, then
    rest_cycles: int  # how many of the first cycles these are of
    valid: Mask  # (n, slots) carries pressure, and no fault was found
    faults: tuple[Change, ...]  # as they began and healed
    readings: Readings
    activation: Array  # (n, slots) counts below rest at the moments of the cycles, on lines between new readings

    @property
    def layout(self) -> Layout:
        """Where the taxels lie."""
        return self.foot.layout

    @property
    def counts(self) -> NDArray[np.uint8]:
        """(n, slots)."""
        return self.foot.counts.reshape(len(self.foot), -1)


def trials(recordings: list[Recording], foot: Foot) -> tuple[list[CalibrationTrial], tuple[str, ...]]:
    """The `foot` of every recording, and a sentence for each thing a person should know.

    CalibrationError lists what makes them unfit: no reference, none without load, other boards or other settings.
    """
    found: list[CalibrationTrial] = []
    wrong: list[str] = []
    remarks: list[str] = []
    for recording in recordings:
        try:
            trial, said = _trial(recording, foot)
        except CalibrationError as error:
            wrong.append(str(error))
            continue
        found.append(trial)
        remarks += said
    for other in found[1:]:
        wrong += _differences(found[0], other)
    if wrong:
        raise CalibrationError("\n".join(wrong))
    return found, tuple(remarks)


def feet(recordings: list[Recording]) -> set[Foot]:
    """Those that every recording has with a reference."""
    return set.intersection(*({f.foot for f in each.feet if f.reference is not None} for each in recordings))


def _trial(recording: Recording, which: Foot) -> tuple[CalibrationTrial, tuple[str, ...]]:
    name = recording.folder.name
    if recording.kind not in ("chamber", "shoe"):
        raise CalibrationError(
            f"{name}: expected a recording of kind chamber or shoe, which has a known load, found {recording.kind}"
        )
    foot = next((each for each in recording.feet if each.foot == which), None)
    if foot is None or foot.reference is None:
        there = " and ".join(f.foot for f in recording.feet if f.reference is not None) or "no"
        raise CalibrationError(
            f"{name}: expected the {which} foot with its reference, found {there} foot with one: "
            f"take the recording out, or calibrate that foot"
        )
    if len(foot) < 2:
        raise CalibrationError(f"{name}: expected cycles of the {which} foot, found {len(foot)}")
    t_s = np.maximum.accumulate((foot.t_ns - foot.t_ns[0]) * 1e-9)
    valid, faults = screened(foot)
    read, remarks = checked_readings(name, recording.kind, foot, t_s)
    counts = foot.counts.reshape(len(foot), -1).astype(np.float64)
    rest = _rest(name, t_s, counts, valid.reshape(len(foot), -1))
    still = np.where(valid.reshape(len(foot), -1)[rest], counts[rest], np.nan)
    seen = np.isfinite(still).sum(axis=0) >= 2
    rest_count, noise_count = np.full((2, counts.shape[1]), np.nan)
    rest_count[seen], noise_count[seen] = np.nanmean(still[:, seen], axis=0), np.nanstd(still[:, seen], axis=0)
    # A taxel that says nothing at rest is zeroed where it is: that it says nothing under load is its verdict.
    rest_count[~seen] = counts[rest][:, ~seen].mean(axis=0)
    return (
        CalibrationTrial(
            name, recording.kind, foot, t_s, rest_count, np.nan_to_num(noise_count), rest.stop,
            valid.reshape(len(foot), -1), faults, read, _activation(foot, t_s, rest_count),
        ),
        remarks,
    )  # fmt: skip


def _activation(foot: FootRecording, t_s: Array, rest_count: Array) -> Array:
    is_new = np.repeat(foot.is_new, N_TAXELS, axis=1)
    behind_s = np.asarray(np.repeat(foot.behind_ns, N_TAXELS, axis=1) * 1e-9, np.float64)
    activation: Array = rest_count - at_cycles(foot.counts.reshape(len(foot), -1), is_new, t_s, behind_s)
    return activation


def _rest(name: str, t_s: Array, counts: Array, valid: Mask) -> slice:
    """The rows before anything presses: until the mean of all taxels leaves where it began."""
    believed = valid.mean(axis=0) > 0.5
    level = counts[:, believed].mean(axis=1) if believed.any() else counts.mean(axis=1)
    first = max(int(np.searchsorted(t_s, LEAST_REST_S)), 2)
    away = np.abs(level - np.median(level[:first])) > _STARTS_COUNT + 4 * float(np.std(level[:first]))
    away[:first] = False
    # Once is chance, or a taxel that broke; three in a row are a load.
    begun = np.flatnonzero(away[:-2] & away[1:-1] & away[2:])
    end_s = t_s[begun[0]] - _SETTLES_S if len(begun) else t_s[-1]
    end = int(np.searchsorted(t_s, min(end_s, _MOST_REST_S)))
    moved = float(np.ptp(np.median(level[: first // 2 * 2].reshape(2, -1), axis=1)))
    if t_s[max(end - 1, 0)] < LEAST_REST_S * 0.8 or moved > _STARTS_COUNT:
        raise CalibrationError(
            f"{name}: expected at least {LEAST_REST_S:g} s without load at its start, on which it is zeroed, "
            "found that the load changes from the first moment on: record from before it begins"
        )
    return slice(0, end)


def screened(foot: FootRecording) -> tuple[Mask, tuple[Change, ...]]:
    """(n, n_triangles, 12) what the daemon would have called valid, cycle by cycle, and the faults that it saw."""
    settings = {board.address: as_configured(board) for board in foot.boards}
    valid = Validity(foot.layout, settings, round(Publish().stale_after_ms * 1e6))(
        foot.counts, foot.status, foot.age_ns
    )
    watch = FaultWatch(foot.layout, settings)
    cycles = _as_cycles(foot)
    changes: list[Change] = []
    for at in range(len(cycles)):
        watch.screen(cycles, at)
        valid[at] &= ~watch.masked
        changes += watch.update(cycles, at)
    return valid, tuple(changes)


def _as_cycles(foot: FootRecording) -> Cycles:
    t_ns = np.maximum.accumulate(foot.t_ns)
    came = 2 * arrived(foot.read_ns)
    return Cycles(
        t_mono_ns=t_ns,
        t_ns=foot.t_ns,
        counts=foot.counts,
        status=foot.status,
        triangle_t_ns=foot.read_ns,
        age_ns=foot.age_ns,
        arrivals=np.cumsum(came, axis=0).astype(np.int64),
        missing=foot.missing,
        late=foot.late,
        repeated=foot.repeated,
    )


def _differences(first: CalibrationTrial, other: CalibrationTrial) -> Iterator[str]:
    """Why two trials cannot be of one calibration."""
    both = f"{first.name} and {other.name}"
    if not np.array_equal(first.layout.identities, other.layout.identities):
        yield f"{both}: expected the same triangles, found other ones: they are of different insoles"
        return
    if not np.allclose(first.layout.xy_m, other.layout.xy_m, atol=1e-6) or not np.isclose(
        first.layout.taxel_area_m2, other.layout.taxel_area_m2
    ):
        yield f"{both}: expected one layout, found two: correct recording.yaml of the one that is wrong"
    known = {board.address: board for board in first.foot.boards}
    for board in other.foot.boards:
        for setting, means in (("shift", "a count means another pressure"), ("no_load", "the range is another one")):
            a, b = getattr(known[board.address], setting), getattr(board, setting)
            if a is not None and b is not None and a != b:
                yield (
                    f"{both}: expected one {setting} of board {board.address}, found {a} and {b}: {means}, "
                    "so they do not make one calibration; calibrate each setting by itself"
                )
