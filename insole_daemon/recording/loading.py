"""`insole_daemon.load(folder)`: a recording as arrays, read the way the daemon reads live."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..config import Board, Foot, Publish
from ..documents import Reading
from ..documents import read as read_document
from ..errors import DocumentError, InsoleError, Problem, RecordingError
from ..mechanics.wrench import WrenchSeries
from ..physics import calibration as calibrations
from ..physics import zero as zeros
from ..physics.calibration import Calibration
from ..physics.zero import Zero
from ..skin import layout as layouts
from ..skin.cycles import Cycles
from ..skin.layout import Layout
from ..skin.validity import Validity
from . import counts as counted
from . import reference as references
from . import views
from .cycles import SAME_PERIOD, age_ns_of, read_log
from .document import (
    FILE,
    FORMAT,
    REFERENCE_COLUMNS,
    CanOrigin,
    Document,
    Kind,
    RecordedBoard,
    RecordedInsole,
    RecordedReference,
    check,
)
from .estimate import estimate
from .read_times import arrived, median_interval_ns, new_readings, overdue
from .reference import Reference

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from ..mechanics.gait.steps import Steps

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FootRecording:
    """n cycles of one foot; triangles in the layout's order, thermal pads among the 12 taxels of each."""

    foot: Foot
    layout: Layout
    boards: tuple[RecordedBoard, ...]  # a setting that is not known is None
    t_ns: NDArray[np.int64]  # (n,) receive time of the newest half, CLOCK_REALTIME; may step
    counts: NDArray[np.uint8]  # (n, n_triangles, 12)
    valid: NDArray[np.bool_]  # (n, n_triangles, 12) may be read as pressure; with a calibration, only what it lists
    status: NDArray[np.uint16]  # (n, n_triangles) status words; 0 where none were kept
    age_ns: NDArray[np.int64]  # (n, n_triangles) of the older half; -1: never received; 0 where none were kept
    read_ns: NDArray[np.int64]  # (n, n_triangles) when the older half was received, on the clock of t_ns; -1: never
    is_new: NDArray[np.bool_]  # (n, n_triangles) a reading that no cycle had before: neither late nor held by its board
    missing: NDArray[np.bool_]  # (n, n_triangles) a reading was due, at the interval of its board, and did not come
    late: NDArray[np.bool_]  # (n,) closed by time, with readings missing
    repeated: NDArray[np.bool_]  # (n,) nothing had arrived since the cycle before
    calibration: Calibration | None  # with the zero's baselines, where there is one
    zero: Zero | None
    pressure_pa: NDArray[np.float32] | None  # (n, n_triangles, 12) NaN: not in the calibration; None: no calibration
    wrench: WrenchSeries | None
    reference: Reference | None

    def __len__(self) -> int:
        """How many cycles there are."""
        return len(self.t_ns)

    @property
    def behind_ns(self) -> NDArray[np.int64]:
        """(n, n_triangles) how long before `t_ns` each reading was received; 0: never."""
        behind: NDArray[np.int64] = np.where(self.read_ns < 0, 0, np.maximum(self.t_ns[:, None] - self.read_ns, 0))
        return behind

    def __repr__(self) -> str:
        """Five lines at most."""
        return views.describe_foot(self)

    def to_dataframe(self) -> pd.DataFrame:
        """A row a cycle, indexed by its time: the wrench, and the reference where its clock is that of the frames."""
        return views.foot_dataframe(self)

    def to_xarray(self) -> xr.Dataset:
        """Everything by cycle, triangle and taxel, with units as attributes."""
        return views.foot_dataset(self)


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """One trial."""

    folder: Path
    kind: Kind
    can_origin: CanOrigin
    invented: tuple[str, ...]  # what of it nobody measured
    feet: tuple[FootRecording, ...]
    warnings: tuple[str, ...]  # a sentence for each thing that is not as it should be
    log: Path | None  # the frames; None where none were kept

    def __getitem__(self, foot: str) -> FootRecording:
        """The recording of the "left" or the "right" foot."""
        for each in self.feet:
            if each.foot == foot:
                return each
        known = " and ".join(each.foot for each in self.feet)
        raise InsoleError(f"{self.folder}: expected one of the recorded feet ({known}), found {foot!r}")

    def __repr__(self) -> str:
        """Five lines at most."""
        return views.describe(self)

    @cached_property
    def steps(self) -> Steps:
        """The steps of both feet: a table with a label a row; see docs/gait.md."""
        return views.steps_of_recording(self)

    def to_dataframe(self) -> pd.DataFrame:
        """The cycles of both feet, each named by a column `foot`, in order of time."""
        return views.dataframe(self)

    def to_xarray(self) -> dict[str, xr.Dataset]:
        """A dataset a foot: feet have cycles and triangles of their own."""
        return {foot.foot: foot.to_xarray() for foot in self.feet}


@dataclass(slots=True)
class _Parts:
    """What was read of one insole before its cycles are."""

    insole: RecordedInsole
    layout: Layout
    calibration: Calibration | None = None
    zero: Zero | None = None
    reference: Reference | None = None


def load(folder: str | os.PathLike[str], progress: Callable[[float], None] = lambda share: None) -> Recording:
    """The recording in `folder`; RecordingError lists all that is wrong with its files, at once.

    `progress` is told the share of the log that has been read.
    """
    return _Loading(Path(folder), progress).recording()


class _Loading:
    """One folder while it is read: goes on after what is wrong, to say everything that is."""

    def __init__(self, folder: Path, progress: Callable[[float], None]) -> None:
        self._folder = folder
        self._progress = progress
        self._errors: list[InsoleError] = []
        self._warnings: list[str] = []
        self._parts: list[_Parts] = []
        self._log: Path | None = None

    def recording(self) -> Recording:
        path = self._folder / FILE
        if not self._folder.is_dir():
            what = "is a file" if self._folder.exists() else "does not exist"
            self._refuse(f"expected the folder of a recording, found that it {what}")
        if not path.exists():
            there = ", ".join(sorted(each.name for each in self._folder.iterdir())[:10]) or "nothing"
            self._refuse(f"expected the folder of a recording, which has a {FILE}, found {there}")
        document = self._tried(partial(read_document, path, Document, FORMAT, self._check))
        if document is None:
            self._judge_log(self._log)
            raise RecordingError(self._errors)
        cycles = self._cycles(document)
        if self._errors:
            raise RecordingError(self._errors)
        self._warn_of_unnamed(document)
        return Recording(
            self._folder, document.kind, document.can_origin, document.invented, tuple(cycles), tuple(self._warnings),
            document.can,
        )  # fmt: skip

    def _refuse(self, message: str) -> NoReturn:
        raise RecordingError([DocumentError(str(self._folder), [Problem(None, "", message)])])

    def _check(self, reading: Reading) -> None:
        """Beside what recording.yaml says itself, everything about the files it names, whatever else is wrong."""
        check(reading)
        document = reading.document
        for key in ("can", "counts"):
            named = document.get(key)
            if isinstance(named, str) and named and not (self._folder / named).exists():
                reading.problem((key,), f"the file {named} is not in the folder")
            elif key == "can" and isinstance(named, str) and named:
                self._log = self._folder / named
        for _, insole in reading.of(RecordedInsole):
            layout = self._tried(partial(_layout, insole))
            if layout is None:
                continue
            parts = _Parts(insole, layout)
            if insole.calibration is not None:
                parts.calibration = self._tried(partial(calibrations.load, insole.calibration, layout))
            if insole.zero is not None:
                parts.zero = self._tried(partial(zeros.load, insole.zero, layout))
            self._parts.append(parts)
        kind = next((kind for kind in REFERENCE_COLUMNS if kind == document.get("kind")), None)
        for _, reference in reading.of(RecordedReference):
            if kind is None:
                continue
            found = self._tried(partial(references.read, reference.file, kind, reference.foot, reference.clock))
            if found is not None:
                self._warnings += found[1]
                for parts in self._parts:
                    if parts.insole.foot == reference.foot:
                        parts.reference = found[0]

    def _cycles(self, document: Document) -> list[FootRecording]:
        """Of every foot whose layout could be read; a log is worth reading only where all could."""
        if len(self._parts) < len(document.insoles):
            self._judge_log(document.can)
            return []
        if document.can is not None:
            log = self._tried(partial(read_log, document.can, [parts.layout for parts in self._parts], self._progress))
            if log is None:
                return []
            self._warnings += log[2]
            feet = [_logged(parts, cycles) for parts, cycles in zip(self._parts, log[0], strict=True)]
            for foot in feet:
                self._warnings += _periods_otherwise(document.can, foot)
            return feet
        path = document.counts or Path()
        sizes: dict[str, int] = {parts.insole.foot: len(parts.layout) for parts in self._parts}
        tables = self._tried(partial(counted.read, path, sizes))
        return [self._counted(path, parts, tables[parts.insole.foot]) for parts in self._parts] if tables else []

    def _counted(self, path: Path, parts: _Parts, table: counted.CountsTable) -> FootRecording:
        shape = table.counts.shape[:2]
        steps = int(np.count_nonzero(np.diff(table.t_ns) < 0))
        if steps:
            self._warnings.append(f"{path}: time goes back {steps} times in the cycles of the {parts.insole.foot} foot")
        age_ns = np.zeros(shape, np.int64) if table.age_ms is None else age_ns_of(table.age_ms)
        missing = np.zeros(shape, np.bool_) if table.missing is None else table.missing.astype(np.bool_)
        repeated = np.zeros(shape[0], np.bool_) if table.repeated is None else table.repeated.astype(np.bool_)
        read_ns = np.where(age_ns < 0, -1, np.maximum.accumulate(table.t_ns)[:, None] - age_ns)
        return _foot(
            parts,
            table.t_ns,
            table.counts,
            np.zeros(shape, np.uint16) if table.status is None else table.status,
            age_ns,
            read_ns,
            new_readings(arrived(read_ns) & ~missing & ~repeated[:, None], table.counts),
            missing,
            np.zeros(shape[0], np.bool_) if table.late is None else table.late.astype(np.bool_),
            repeated,
            None if table.valid is None else table.valid.astype(np.bool_),
        )

    def _judge_log(self, log: Path | None) -> None:
        """Say what is wrong with a log whose cycles cannot be told for other reasons."""
        if log is not None:
            self._tried(partial(read_log, log, ()))

    def _tried(self, read: Callable[[], T]) -> T | None:
        try:
            return read()
        except InsoleError as error:
            self._errors.append(error)
            return None

    def _warn_of_unnamed(self, document: Document) -> None:
        named = {reference.file for reference in document.reference}
        named |= {path for each in document.insoles for path in (each.layout, each.calibration, each.zero) if path}
        for name in ("zero.json", "calibration.json", "layout.yaml", "reference.csv"):
            path = self._folder / name
            if path.exists() and path not in named:
                self._warnings.append(f"{path}: is there, but {FILE} does not name it: it is not used")


def _layout(insole: RecordedInsole) -> Layout:
    if insole.layout is not None:
        return layouts.load(insole.layout, insole.foot, insole.addresses)
    if len(insole.boards) != 3:
        raise InsoleError(f"the {insole.foot} foot has no layout")  # which check() says better
    front, middle, rear = insole.addresses
    return layouts.builtin(insole.foot, (front, middle, rear))


def as_configured(board: Board | RecordedBoard) -> Board:
    """A board's settings for the rules that need them: what is not known is what the daemon assumes of a board."""
    known = {
        name: value
        for name in ("period_ms", "shift", "no_load", "skin_type")
        if (value := getattr(board, name)) is not None
    }
    return Board(address=board.address, interface=board.interface or "can0", **known)


def _logged(parts: _Parts, cycles: Cycles) -> FootRecording:
    """The foot of a log: a reading is due at the interval of its board, whenever the cycles close."""
    read_mono_ns = np.where(cycles.age_ns < 0, -1, cycles.t_mono_ns[:, None] - cycles.age_ns)
    came = arrived(read_mono_ns)
    missing = overdue(came, read_mono_ns, cycles.t_mono_ns)
    return _foot(
        parts,
        cycles.t_ns,
        cycles.counts,
        cycles.status,
        cycles.age_ns,
        np.where(cycles.age_ns < 0, -1, cycles.triangle_t_ns),
        new_readings(came, cycles.counts),
        missing,
        cycles.late & missing.any(axis=1),
        cycles.repeated,
        None,
    )


def _periods_otherwise(log: Path, foot: FootRecording) -> Iterator[str]:
    """A sentence for each board that sends at another period than it was told, or has new readings less often."""
    address = foot.layout.identities[:, 0]
    for board in foot.boards:
        own = np.flatnonzero(address == board.address)
        came = arrived(foot.read_ns[:, own])
        sent_ms, new_ms = (
            1e-6 * float(np.median([median_interval_ns(foot.read_ns[flags[:, i], k]) for i, k in enumerate(own)]))
            for flags in (came, foot.is_new[:, own])
        )
        if board.period_ms is not None and abs(sent_ms - board.period_ms) > SAME_PERIOD * board.period_ms:
            yield (
                f"{log}: board {board.address} sends every {sent_ms:.0f} ms, {FILE} says {board.period_ms}: "
                "its frames are believed"
            )
        if new_ms > (1.0 + SAME_PERIOD) * sent_ms:
            yield f"{log}: board {board.address} sends every {sent_ms:.0f} ms, with new readings every {new_ms:.0f} ms"


def _foot(
    parts: _Parts,
    t_ns: NDArray[np.int64],
    counts: NDArray[np.uint8],
    status: NDArray[np.uint16],
    age_ns: NDArray[np.int64],
    read_ns: NDArray[np.int64],
    is_new: NDArray[np.bool_],
    missing: NDArray[np.bool_],
    late: NDArray[np.bool_],
    repeated: NDArray[np.bool_],
    valid: NDArray[np.bool_] | None,
) -> FootRecording:
    """The foot with validity, pressure and wrench by the daemon's rules and defaults; `valid` where a daemon said."""
    layout = parts.layout
    if valid is None:
        settings = {board.address: as_configured(board) for board in parts.insole.boards}
        valid = Validity(layout, settings, round(Publish().stale_after_ms * 1e6))(counts, status, age_ns)
    calibration, pressure_pa, wrench = parts.calibration, None, None
    if calibration is not None:
        if parts.zero is not None:
            calibration = zeros.apply(calibration, parts.zero)
        boards = [as_configured(board) for board in parts.insole.boards]
        said = estimate(layout, calibration, boards, t_ns, counts, valid, zeroed=parts.zero is not None)
        valid, pressure_pa, wrench = valid & calibration.usable, said.pressure_pa, said.wrench
    for array in (t_ns, counts, valid, status, age_ns, read_ns, is_new, missing, late, repeated, pressure_pa):
        if array is not None:
            array.setflags(write=False)
    return FootRecording(
        parts.insole.foot, layout, parts.insole.boards, t_ns, counts, valid, status, age_ns, read_ns, is_new, missing,
        late, repeated, calibration, parts.zero, pressure_pa, wrench, parts.reference,
    )  # fmt: skip
