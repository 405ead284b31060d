"""Load a recording as arrays, read the same way as the daemon reads live: `insole_daemon.load(folder)`."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..config import Board, Foot, Publish
from ..documents import Reading
from ..documents import read as read_document
from ..errors import CalibrationError, DocumentError, InsoleError, Problem, RecordingError
from ..mechanics.wrench import WrenchSeries
from ..physics import calibration as calibrations
from ..physics import zero as zeros
from ..physics.calibration import Calibration
from ..physics.zero import Zero
from ..skin import layout as layouts
from ..skin.cycles import Cycles
from ..skin.layout import Layout
from ..skin.validity import Validity
from . import counts as counts_file
from . import reference as references
from . import views
from .cycles import SAME_PERIOD, age_ns_from_ms, read_log
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
from .read_times import arrived, find_new_readings, find_overdue, median_interval_ns
from .reference import Reference

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from ..mechanics.gait.steps import Steps

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FootRecording:
    """One foot in n cycles; triangles in the layout's order, with 12 taxels each including the thermal pads."""

    foot: Foot
    layout: Layout
    boards: tuple[RecordedBoard, ...]  # unknown settings are None
    t_ns: NDArray[np.int64]  # (n,) receive time of the newest half, CLOCK_REALTIME; may step
    counts: NDArray[np.uint8]  # (n, n_triangles, 12)
    valid: NDArray[np.bool_]  # (n, n_triangles, 12) usable as pressure; with a calibration only its taxels
    status: NDArray[np.uint16]  # (n, n_triangles) status words; 0 if the recording has none
    age_ns: NDArray[np.int64]  # (n, n_triangles) of the older half; -1: never received; 0 if the recording has none
    read_ns: NDArray[np.int64]  # (n, n_triangles) when the older half was received, on the clock of t_ns; -1: never
    is_new: NDArray[np.bool_]  # (n, n_triangles) first cycle with this reading; no repetition by its board
    missing: NDArray[np.bool_]  # (n, n_triangles) a reading was due by its board's interval and is missing
    late: NDArray[np.bool_]  # (n,) closed by time with readings missing
    repeated: NDArray[np.bool_]  # (n,) no half arrived since the previous cycle
    calibration: Calibration | None  # with the baselines of `zero`, if there is one
    zero: Zero | None
    # (n, n_triangles, 12) NaN: taxel not in the calibration; None: no calibration
    pressure_pa: NDArray[np.float32] | None
    wrench: WrenchSeries | None
    reference: Reference | None

    def __len__(self) -> int:
        """Return the number of cycles."""
        return len(self.t_ns)

    @property
    def behind_ns(self) -> NDArray[np.int64]:
        """Return (n, n_triangles) how long before `t_ns` each reading was received; 0 if never."""
        behind_ns: NDArray[np.int64] = np.where(self.read_ns < 0, 0, np.maximum(self.t_ns[:, None] - self.read_ns, 0))
        return behind_ns

    def __repr__(self) -> str:
        """Describe the foot in at most five lines."""
        return views.describe_foot(self)

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per cycle, indexed by time: the wrench, and a reference that is on the frames' clock."""
        return views.foot_to_dataframe(self)

    def to_xarray(self) -> xr.Dataset:
        """Return all arrays by cycle, triangle and taxel, with units as attributes."""
        return views.foot_to_dataset(self)


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """One trial: its feet, and what is known about how they were recorded."""

    folder: Path
    kind: Kind
    can_origin: CanOrigin
    invented: tuple[str, ...]  # a sentence per item that was not measured
    feet: tuple[FootRecording, ...]
    warnings: tuple[str, ...]  # a sentence per irregularity
    log: Path | None  # the CAN log; None if the recording has counts only
    calibration_files: Mapping[Foot, Path] = field(default_factory=dict)  # by foot, in place of the recording's own

    def __getitem__(self, foot: str) -> FootRecording:
        """Return the recording of the "left" or "right" foot; InsoleError if that foot is not recorded."""
        for recording in self.feet:
            if recording.foot == foot:
                return recording
        known = " and ".join(recording.foot for recording in self.feet)
        raise InsoleError(f"{self.folder}: expected one of the recorded feet ({known}), found {foot!r}")

    def __repr__(self) -> str:
        """Describe the recording in at most five lines."""
        return views.describe(self)

    @cached_property
    def steps(self) -> Steps:
        """Return the steps of both feet, a table with one labelled row per step; see docs/gait.md."""
        return views.steps_of_recording(self)

    def to_dataframe(self) -> pd.DataFrame:
        """Return the cycles of both feet in order of time, with the foot in a column `foot`."""
        return views.to_dataframe(self)

    def to_xarray(self) -> dict[str, xr.Dataset]:
        """Return one dataset per foot, since the feet have different cycles and triangles."""
        return {foot.foot: foot.to_xarray() for foot in self.feet}


@dataclass(slots=True)
class _InsoleFiles:
    """The contents of one insole's files, before its cycles are read."""

    insole: RecordedInsole
    layout: Layout
    calibration: Calibration | None = None
    zero: Zero | None = None
    reference: Reference | None = None


def load(
    folder: str | os.PathLike[str],
    progress: Callable[[float], None] = lambda share: None,
    calibration_files: Sequence[str | os.PathLike[str]] = (),
) -> Recording:
    """Load the recording in `folder`; RecordingError lists all problems of its files together.

    `progress` is called with the fraction of the log that has been read. `calibration_files`, one a foot, replace those
    of the recording.
    """
    by_foot = calibrations.files_by_foot([Path(file) for file in calibration_files])
    recording = _Loader(Path(folder), progress, by_foot).recording()
    recorded = {foot.foot for foot in recording.feet}
    for foot, file in by_foot.items():
        if foot not in recorded:
            raise CalibrationError(f"{file}: a calibration of the {foot} foot, which {folder} does not have")
    return recording


class _Loader:
    """Reads one folder, and continues after an error in order to report all of them."""

    def __init__(self, folder: Path, progress: Callable[[float], None], calibration_files: Mapping[Foot, Path]) -> None:
        self._folder = folder
        self._progress = progress
        self._calibration_files = calibration_files
        self._errors: list[InsoleError] = []
        self._warnings: list[str] = []
        self._insoles: list[_InsoleFiles] = []
        self._log: Path | None = None

    def recording(self) -> Recording:
        """Return the recording; RecordingError with all problems."""
        path = self._folder / FILE
        if not self._folder.is_dir():
            what = "is a file" if self._folder.exists() else "does not exist"
            self._refuse(f"expected the folder of a recording, found that it {what}")
        if not path.exists():
            content = ", ".join(sorted(entry.name for entry in self._folder.iterdir())[:10]) or "nothing"
            self._refuse(f"expected the folder of a recording, which has a {FILE}, found {content}")
        document = self._collect_errors(partial(read_document, path, Document, FORMAT, self._check))
        if document is None:
            self._check_log(self._log)
            raise RecordingError(self._errors)
        cycles = self._read_cycles(document)
        if self._errors:
            raise RecordingError(self._errors)
        self._warn_about_unnamed_files(document)
        return Recording(
            self._folder, document.kind, document.can_origin, document.invented, tuple(cycles), tuple(self._warnings),
            document.can, self._calibration_files,
        )  # fmt: skip

    def _refuse(self, message: str) -> NoReturn:
        raise RecordingError([DocumentError(str(self._folder), [Problem(None, "", message)])])

    def _check(self, reading: Reading) -> None:
        """Report problems of recording.yaml itself and of every file it names."""
        check(reading)
        document = reading.document
        for key in ("can", "counts"):
            named = document.get(key)
            if isinstance(named, str) and named and not (self._folder / named).exists():
                reading.problem((key,), f"the file {named} is not in the folder")
            elif key == "can" and isinstance(named, str) and named:
                self._log = self._folder / named
        for _, insole in reading.of(RecordedInsole):
            layout = self._collect_errors(partial(_load_layout, insole))
            if layout is None:
                continue
            files = _InsoleFiles(insole, layout)
            calibration = self._calibration_files.get(insole.foot, insole.calibration)
            if calibration is not None:
                files.calibration = self._collect_errors(partial(calibrations.load, calibration, layout))
            if insole.zero is not None:
                files.zero = self._collect_errors(partial(zeros.load, insole.zero, layout))
            self._insoles.append(files)
        kind = next((kind for kind in REFERENCE_COLUMNS if kind == document.get("kind")), None)
        for _, reference in reading.of(RecordedReference):
            if kind is None:
                continue
            result = self._collect_errors(
                partial(references.read, reference.file, kind, reference.foot, reference.clock)
            )
            if result is not None:
                self._warnings += result[1]
                for files in self._insoles:
                    if files.insole.foot == reference.foot:
                        files.reference = result[0]

    def _read_cycles(self, document: Document) -> list[FootRecording]:
        """Return the feet whose layout could be read; read the log only if all layouts could."""
        if len(self._insoles) < len(document.insoles):
            self._check_log(document.can)
            return []
        if document.can is not None:
            log = self._collect_errors(
                partial(read_log, document.can, [files.layout for files in self._insoles], self._progress)
            )
            if log is None:
                return []
            self._warnings += log[2]
            feet = [_foot_of_log(files, cycles) for files, cycles in zip(self._insoles, log[0], strict=True)]
            for foot in feet:
                self._warnings += _period_warnings(document.can, foot)
            return feet
        path = document.counts or Path()
        sizes: dict[str, int] = {files.insole.foot: len(files.layout) for files in self._insoles}
        tables = self._collect_errors(partial(counts_file.read, path, sizes))
        return (
            [self._foot_of_counts(path, files, tables[files.insole.foot]) for files in self._insoles] if tables else []
        )

    def _foot_of_counts(self, path: Path, files: _InsoleFiles, table: counts_file.CountsTable) -> FootRecording:
        """Build the foot whose cycles are in a counts file."""
        shape = table.counts.shape[:2]
        n_backward_steps = int(np.count_nonzero(np.diff(table.t_ns) < 0))
        if n_backward_steps:
            self._warnings.append(
                f"{path}: time goes back {n_backward_steps} times in the cycles of the {files.insole.foot} foot"
            )
        age_ns = np.zeros(shape, np.int64) if table.age_ms is None else age_ns_from_ms(table.age_ms)
        missing = np.zeros(shape, np.bool_) if table.missing is None else table.missing.astype(np.bool_)
        repeated = np.zeros(shape[0], np.bool_) if table.repeated is None else table.repeated.astype(np.bool_)
        read_ns = np.where(age_ns < 0, -1, np.maximum.accumulate(table.t_ns)[:, None] - age_ns)
        return _build_foot(
            files,
            table.t_ns,
            table.counts,
            np.zeros(shape, np.uint16) if table.status is None else table.status,
            age_ns,
            read_ns,
            find_new_readings(arrived(read_ns) & ~missing & ~repeated[:, None], table.counts),
            missing,
            np.zeros(shape[0], np.bool_) if table.late is None else table.late.astype(np.bool_),
            repeated,
            None if table.valid is None else table.valid.astype(np.bool_),
        )

    def _check_log(self, log: Path | None) -> None:
        """Collect the problems of a log whose cycles cannot be read because of other errors."""
        if log is not None:
            self._collect_errors(partial(read_log, log, ()))

    def _collect_errors(self, read: Callable[[], T]) -> T | None:
        """Return what `read` returns, or None after noting its InsoleError."""
        try:
            return read()
        except InsoleError as error:
            self._errors.append(error)
            return None

    def _warn_about_unnamed_files(self, document: Document) -> None:
        """Warn about files of the folder that recording.yaml does not name."""
        named = {reference.file for reference in document.reference}
        named |= {
            path for insole in document.insoles for path in (insole.layout, insole.calibration, insole.zero) if path
        }
        for name in ("zero.json", "calibration.json", "layout.yaml", "reference.csv"):
            path = self._folder / name
            if path.exists() and path not in named:
                self._warnings.append(f"{path}: is there, but {FILE} does not name it: it is not used")


def _load_layout(insole: RecordedInsole) -> Layout:
    """Load the layout of `insole`, or build the built-in one for its three boards."""
    if insole.layout is not None:
        return layouts.load(insole.layout, insole.foot, insole.addresses)
    if len(insole.boards) != 3:
        raise InsoleError(f"the {insole.foot} foot has no layout")  # check() reports it with its line
    front, middle, rear = insole.addresses
    return layouts.builtin(insole.foot, (front, middle, rear))


def as_configured(board: Board | RecordedBoard) -> Board:
    """Return the settings of `board` as a configured board; unknown settings take the daemon's defaults."""
    known = {
        name: value
        for name in ("period_ms", "shift", "no_load", "skin_type")
        if (value := getattr(board, name)) is not None
    }
    return Board(address=board.address, interface=board.interface or "can0", **known)


def _foot_of_log(files: _InsoleFiles, cycles: Cycles) -> FootRecording:
    """Build the foot whose cycles come from a log; a reading is due by its board's interval."""
    read_mono_ns = np.where(cycles.age_ns < 0, -1, cycles.t_mono_ns[:, None] - cycles.age_ns)
    came = arrived(read_mono_ns)
    missing = find_overdue(came, read_mono_ns, cycles.t_mono_ns)
    return _build_foot(
        files,
        cycles.t_ns,
        cycles.counts,
        cycles.status,
        cycles.age_ns,
        np.where(cycles.age_ns < 0, -1, cycles.triangle_t_ns),
        find_new_readings(came, cycles.counts),
        missing,
        cycles.late & missing.any(axis=1),
        cycles.repeated,
        None,
    )


def _period_warnings(log: Path, foot: FootRecording) -> Iterator[str]:
    """Yield a sentence for each board whose frames show another period than configured, or new readings less often."""
    address = foot.layout.identities[:, 0]
    for board in foot.boards:
        triangles = np.flatnonzero(address == board.address)
        came = arrived(foot.read_ns[:, triangles])
        sent_ms, new_ms = (
            1e-6 * float(np.median([median_interval_ns(foot.read_ns[flags[:, i], k]) for i, k in enumerate(triangles)]))
            for flags in (came, foot.is_new[:, triangles])
        )
        if board.period_ms is not None and abs(sent_ms - board.period_ms) > SAME_PERIOD * board.period_ms:
            yield (
                f"{log}: board {board.address} sends every {sent_ms:.0f} ms, {FILE} says {board.period_ms}: "
                "its frames are believed"
            )
        if new_ms > (1.0 + SAME_PERIOD) * sent_ms:
            yield f"{log}: board {board.address} sends every {sent_ms:.0f} ms, with new readings every {new_ms:.0f} ms"


def _build_foot(
    files: _InsoleFiles,
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
    """Return the foot with validity, pressure and wrench by the daemon's rules and defaults.

    `valid` (n, n_triangles, 12) is what a daemon published, or None to apply the rules of validity here.
    """
    layout = files.layout
    if valid is None:
        settings = {board.address: as_configured(board) for board in files.insole.boards}
        valid = Validity(layout, settings, round(Publish().stale_after_ms * 1e6))(counts, status, age_ns)
    calibration, pressure_pa, wrench = files.calibration, None, None
    if calibration is not None:
        if files.zero is not None:
            calibration = zeros.apply(calibration, files.zero)
        boards = [as_configured(board) for board in files.insole.boards]
        estimated = estimate(layout, calibration, boards, t_ns, counts, valid, zeroed=files.zero is not None)
        valid, pressure_pa, wrench = valid & calibration.usable, estimated.pressure_pa, estimated.wrench
    for array in (t_ns, counts, valid, status, age_ns, read_ns, is_new, missing, late, repeated, pressure_pa):
        if array is not None:
            array.setflags(write=False)
    return FootRecording(
        files.insole.foot, layout, files.insole.boards, t_ns, counts, valid, status, age_ns, read_ns, is_new, missing,
        late, repeated, calibration, files.zero, pressure_pa, wrench, files.reference,
    )  # fmt: skip
