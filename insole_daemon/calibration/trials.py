"""Prepare one foot of a recording for fitting or validation: activation, valid readings, and the reference.

Every trial is zeroed on its own start: the activation is a taxel's mean unloaded count minus its count. Readings are
masked by the same fault detection as in the daemon.
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
from .references import Readings, check_readings

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MIN_REST_S = 0.5
_MAX_REST_S = 30.0
_LOAD_BEGIN_COUNT = 0.3  # change of the insole's mean count by which the begin of the load is detected
_LOAD_MARGIN_S = 0.1  # ignored before the begin of the load


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationTrial:
    """The n cycles of one foot with its reference; slots are the layout's triangles times 12."""

    name: str
    kind: Literal["chamber", "shoe"]
    foot: FootRecording
    t_s: Array  # (n,) since the first cycle
    rest_count: Array  # (slots,) mean count before the load begins
    noise_count: Array  # (slots,) standard deviation of one reading before the load begins
    rest_cycles: int  # number of first cycles without load
    valid: Mask  # (n, slots) usable as pressure, and no fault detected
    faults: tuple[Change, ...]  # begins and ends of faults
    readings: Readings
    activation: Array  # (n, slots) counts below rest_count at the cycles, interpolated between new readings

    @property
    def layout(self) -> Layout:
        """Return the layout of the foot."""
        return self.foot.layout

    @property
    def counts(self) -> NDArray[np.uint8]:
        """Return (n, slots) the counts."""
        return self.foot.counts.reshape(len(self.foot), -1)


def prepare_trials(recordings: list[Recording], foot: Foot) -> tuple[list[CalibrationTrial], tuple[str, ...]]:
    """Prepare the `foot` of every recording; return the trials and a sentence for each irregularity.

    CalibrationError lists all problems: no reference, no unloaded start, other boards or other settings.
    """
    prepared: list[CalibrationTrial] = []
    errors: list[str] = []
    remarks: list[str] = []
    for recording in recordings:
        try:
            trial, trial_remarks = _prepare_trial(recording, foot)
        except CalibrationError as error:
            errors.append(str(error))
            continue
        prepared.append(trial)
        remarks += trial_remarks
    for other in prepared[1:]:
        errors += _find_differences(prepared[0], other)
    if errors:
        raise CalibrationError("\n".join(errors))
    return prepared, tuple(remarks)


def feet_with_reference(recordings: list[Recording]) -> set[Foot]:
    """Return the feet that have a reference in every recording."""
    return set.intersection(*({f.foot for f in recording.feet if f.reference is not None} for recording in recordings))


def _prepare_trial(recording: Recording, which: Foot) -> tuple[CalibrationTrial, tuple[str, ...]]:
    """Prepare one recording: check it, screen faults, and compute the unloaded counts and the activation."""
    name = recording.folder.name
    if recording.kind not in ("chamber", "shoe"):
        raise CalibrationError(
            f"{name}: expected a recording of kind chamber or shoe, which has a known load, found {recording.kind}"
        )
    foot = next((candidate for candidate in recording.feet if candidate.foot == which), None)
    if foot is None or foot.reference is None:
        available = " and ".join(f.foot for f in recording.feet if f.reference is not None) or "no"
        raise CalibrationError(
            f"{name}: expected the {which} foot with its reference, found {available} foot with one: "
            f"leave this recording out, or calibrate that foot"
        )
    if len(foot) < 2:
        raise CalibrationError(f"{name}: expected cycles of the {which} foot, found {len(foot)}")
    t_s = np.maximum.accumulate((foot.t_ns - foot.t_ns[0]) * 1e-9)
    valid, faults = screened(foot)
    readings, remarks = check_readings(name, recording.kind, foot, t_s)
    counts = foot.counts.reshape(len(foot), -1).astype(np.float64)
    rest_rows = _find_rest(name, t_s, counts, valid.reshape(len(foot), -1))
    rest_counts = np.where(valid.reshape(len(foot), -1)[rest_rows], counts[rest_rows], np.nan)
    has_rest = np.isfinite(rest_counts).sum(axis=0) >= 2
    rest_count, noise_count = np.full((2, counts.shape[1]), np.nan)
    rest_count[has_rest], noise_count[has_rest] = (
        np.nanmean(rest_counts[:, has_rest], axis=0),
        np.nanstd(rest_counts[:, has_rest], axis=0),
    )
    # A taxel without valid readings at rest is zeroed on its counts; the verdict then judges it under load.
    rest_count[~has_rest] = counts[rest_rows][:, ~has_rest].mean(axis=0)
    return (
        CalibrationTrial(
            name, recording.kind, foot, t_s, rest_count, np.nan_to_num(noise_count), rest_rows.stop,
            valid.reshape(len(foot), -1), faults, readings, _compute_activation(foot, t_s, rest_count),
        ),
        remarks,
    )  # fmt: skip


def _compute_activation(foot: FootRecording, t_s: Array, rest_count: Array) -> Array:
    is_new = np.repeat(foot.is_new, N_TAXELS, axis=1)
    behind_s = np.asarray(np.repeat(foot.behind_ns, N_TAXELS, axis=1) * 1e-9, np.float64)
    activation: Array = rest_count - at_cycles(foot.counts.reshape(len(foot), -1), is_new, t_s, behind_s)
    return activation


def _find_rest(name: str, t_s: Array, counts: Array, valid: Mask) -> slice:
    """Return the rows before the load begins, which is when the mean of all taxels leaves its initial level."""
    is_mostly_valid = valid.mean(axis=0) > 0.5
    level = counts[:, is_mostly_valid].mean(axis=1) if is_mostly_valid.any() else counts.mean(axis=1)
    first = max(int(np.searchsorted(t_s, MIN_REST_S)), 2)
    has_moved = np.abs(level - np.median(level[:first])) > _LOAD_BEGIN_COUNT + 4 * float(np.std(level[:first]))
    has_moved[:first] = False
    # A single deviation may be noise or a broken taxel; three in a row are a load.
    load_rows = np.flatnonzero(has_moved[:-2] & has_moved[1:-1] & has_moved[2:])
    end_s = t_s[load_rows[0]] - _LOAD_MARGIN_S if len(load_rows) else t_s[-1]
    end = int(np.searchsorted(t_s, min(end_s, _MAX_REST_S)))
    start_change = float(np.ptp(np.median(level[: first // 2 * 2].reshape(2, -1), axis=1)))
    if t_s[max(end - 1, 0)] < MIN_REST_S * 0.8 or start_change > _LOAD_BEGIN_COUNT:
        raise CalibrationError(
            f"{name}: expected at least {MIN_REST_S:g} s without load at its start, on which it is zeroed, "
            "found that the load changes from the first moment on: record from before it begins"
        )
    return slice(0, end)


def screened(foot: FootRecording) -> tuple[Mask, tuple[Change, ...]]:
    """Return (n, n_triangles, 12) validity as the daemon determines it, cycle by cycle, and the faults it detects."""
    settings = {board.address: as_configured(board) for board in foot.boards}
    valid = Validity(foot.layout, settings, round(Publish().stale_after_ms * 1e6))(
        foot.counts, foot.status, foot.age_ns
    )
    watch = FaultWatch(foot.layout, settings)
    cycles = _as_cycles(foot)
    changes: list[Change] = []
    for row in range(len(cycles)):
        watch.screen(cycles, row)
        valid[row] &= ~watch.masked
        changes += watch.update(cycles, row)
    return valid, tuple(changes)


def _as_cycles(foot: FootRecording) -> Cycles:
    """Return the recording as cycles for the fault detection."""
    t_ns = np.maximum.accumulate(foot.t_ns)
    n_arrived = 2 * arrived(foot.read_ns)
    return Cycles(
        t_mono_ns=t_ns,
        t_ns=foot.t_ns,
        counts=foot.counts,
        status=foot.status,
        triangle_t_ns=foot.read_ns,
        age_ns=foot.age_ns,
        arrivals=np.cumsum(n_arrived, axis=0).astype(np.int64),
        missing=foot.missing,
        late=foot.late,
        repeated=foot.repeated,
    )


def _find_differences(first: CalibrationTrial, other: CalibrationTrial) -> Iterator[str]:
    """Yield the reasons why two trials cannot belong to one calibration."""
    names = f"{first.name} and {other.name}"
    if not np.array_equal(first.layout.identities, other.layout.identities):
        yield f"{names}: expected the same triangles, found different ones: the recordings are of different insoles"
        return
    if not np.allclose(first.layout.xy_m, other.layout.xy_m, atol=1e-6) or not np.isclose(
        first.layout.taxel_area_m2, other.layout.taxel_area_m2
    ):
        yield f"{names}: expected one layout, found two: correct the wrong one in its recording.yaml"
    known = {board.address: board for board in first.foot.boards}
    for board in other.foot.boards:
        for setting, consequence in (
            ("shift", "a count has another meaning"),
            ("no_load", "the range of counts differs"),
        ):
            a, b = getattr(known[board.address], setting), getattr(board, setting)
            if a is not None and b is not None and a != b:
                yield (
                    f"{names}: expected one {setting} of board {board.address}, found {a} and {b}: {consequence}, "
                    "so they cannot be calibrated together; calibrate each setting separately"
                )
