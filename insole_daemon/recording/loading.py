"""`insole_daemon.load(folder)`: a recording as arrays, read the way the daemon reads live."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NoReturn, TypeVar

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
from ..skin.layout import Layout
from ..skin.validity import Validity
from . import counts as counted
from . import reference as references
from .cycles import age_ns_of, read_log
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
from .reference import Reference

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
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
    missing: NDArray[np.bool_]  # (n, n_triangles) a half was expected and did not come
    late: NDArray[np.bool_]  # (n,)
    repeated: NDArray[np.bool_]  # (n,) nothing had arrived since the cycle before
    calibration: Calibration | None  # with the zero's baselines, where there is one
    zero: Zero | None
    pressure_pa: NDArray[np.float32] | None  # (n, n_triangles, 12) NaN: not in the calibration; None: no calibration
    wrench: WrenchSeries | None
    reference: Reference | None

    def __len__(self) -> int:
        """How many cycles there are."""
        return len(self.t_ns)


@dataclass(frozen=True, slots=True, eq=False)
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


@dataclass(slots=True)
class _Parts:
    """What was read of one insole before its cycles are."""

    insole: RecordedInsole
    layout: Layout
    calibration: Calibration | None = None
    zero: Zero | None = None
    reference: Reference | None = None


def load(folder: str | os.PathLike[str]) -> Recording:
    """The recording in `folder`; RecordingError lists all that is wrong with its files, at once."""
    return _Loading(Path(folder)).recording()


class _Loading:
    """One folder while it is read: goes on after what is wrong, to say everything that is."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
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
        raise RecordingError([DocumentError(str(self._folder), [Problem(None, "(folder)", message)])])

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
            log = self._tried(partial(read_log, document.can, [parts.layout for parts in self._parts]))
            if log is None:
                return []
            self._warnings += log[2]
            return [
                _foot(parts, c.t_ns, c.counts, c.status, c.age_ns, c.missing, c.late, c.repeated, None)
                for parts, c in zip(self._parts, log[0], strict=True)
            ]
        path = document.counts or Path()
        sizes: dict[str, int] = {parts.insole.foot: len(parts.layout) for parts in self._parts}
        tables = self._tried(partial(counted.read, path, sizes))
        return [self._counted(path, parts, tables[parts.insole.foot]) for parts in self._parts] if tables else []

    def _counted(self, path: Path, parts: _Parts, table: counted.CountsTable) -> FootRecording:
        shape = table.counts.shape[:2]
        steps = int(np.count_nonzero(np.diff(table.t_ns) < 0))
        if steps:
            self._warnings.append(f"{path}: time goes back {steps} times in the cycles of the {parts.insole.foot} foot")
        return _foot(
            parts,
            table.t_ns,
            table.counts,
            np.zeros(shape, np.uint16) if table.status is None else table.status,
            np.zeros(shape, np.int64) if table.age_ms is None else age_ns_of(table.age_ms),
            np.zeros(shape, np.bool_) if table.missing is None else table.missing.astype(np.bool_),
            np.zeros(shape[0], np.bool_) if table.late is None else table.late.astype(np.bool_),
            np.zeros(shape[0], np.bool_) if table.repeated is None else table.repeated.astype(np.bool_),
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


def _foot(
    parts: _Parts,
    t_ns: NDArray[np.int64],
    counts: NDArray[np.uint8],
    status: NDArray[np.uint16],
    age_ns: NDArray[np.int64],
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
    for array in (t_ns, counts, valid, status, age_ns, missing, late, repeated, pressure_pa):
        if array is not None:
            array.setflags(write=False)
    return FootRecording(
        parts.insole.foot, layout, parts.insole.boards, t_ns, counts, valid, status, age_ns, missing, late, repeated,
        calibration, parts.zero, pressure_pa, wrench, parts.reference,
    )  # fmt: skip
