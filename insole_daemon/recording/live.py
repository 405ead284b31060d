"""A recording while it grows: nothing that was received is lost by a kill, and little by a power cut.

Every portion is handed to the kernel the moment it comes, so a killed recorder leaves all of it; twice a second a
thread makes it durable, so that the loop that reads never waits for a disk. The folder is whole from its first
second: recording.yaml is there before the first frame, and says `kind: free` until a reference has come.
"""

from __future__ import annotations

import os
import queue
import shutil
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..bus.candump_writer import CandumpWriter
from ..bus.frames import FrameBatch
from ..config import Foot
from ..errors import FileError
from ..files import write_text
from . import counts as counted
from .copies import InsoleContents, write_insoles
from .counts import GrowingCounts
from .document import FILE, Clock, Kind, dump
from .writer import refuse_existing

_SYNC_S = 0.5
T = TypeVar("T")


class _OpenFile(Protocol):
    def fileno(self) -> int: ...
    def close(self) -> None: ...


class Durable:
    """Makes files durable in a thread of its own, and closes those that are retired."""

    def __init__(self) -> None:
        """Begin."""
        self._files: list[_OpenFile] = []
        self._tasks: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._failed: OSError | None = None
        self._thread = threading.Thread(target=self._run, name="durable", daemon=True)
        self._thread.start()

    def watch(self, file: _OpenFile) -> None:
        """Make what is written to `file` durable from now on."""
        self._tasks.put(lambda: self._files.append(file))

    def retire(self, files: Sequence[_OpenFile], then: Callable[[], None]) -> None:
        """Close `files` once they are durable, and do `then`; returns at once."""
        self._tasks.put(lambda: self._retire(files, then))

    def check(self) -> None:
        """Raise OSError where the disk has failed since."""
        if self._failed is not None:
            raise self._failed

    def close(self) -> None:
        """Finish everything; raises OSError where that failed."""
        self._stop.set()
        self._thread.join()
        self.check()

    def _run(self) -> None:
        stopping = False
        while not stopping:
            stopping = self._stop.wait(_SYNC_S)
            try:
                while not self._tasks.empty():
                    self._tasks.get()()
                for file in self._files:
                    os.fdatasync(file.fileno())
            except OSError as error:
                self._failed = self._failed or error

    def _retire(self, files: Sequence[_OpenFile], then: Callable[[], None]) -> None:
        for file in files:
            self._files.remove(file)
            os.fdatasync(file.fileno())
            file.close()
        then()


@dataclass(slots=True)
class _Part:
    """One folder and its open files."""

    folder: Path
    document: dict[str, Any]
    log: BinaryIO | None = None
    candump: CandumpWriter | None = None
    counts: dict[str, GrowingCounts] = field(default_factory=dict)
    references: dict[str, BinaryIO] = field(default_factory=dict)

    def size(self) -> int:
        return (self.log.tell() if self.log else 0) + sum(each.size for each in self.counts.values())

    def files(self) -> list[_OpenFile]:
        logs: list[_OpenFile] = [self.log] if self.log else []
        return [*logs, *self.counts.values(), *self.references.values()]

    def write_document(self) -> None:
        write_text(self.folder / FILE, dump(self.document))


class LiveRecorder:
    """Writes the folder `out`, and out-2, out-3 … once one has `rotate_bytes` of readings.

    With `interfaces` it takes frames, without them cycles. Every folder is a recording that stands alone.
    Raises FileError where a folder is already there or the disk fails.
    """

    def __init__(
        self,
        out: Path,
        kind: Kind,
        insoles: Sequence[InsoleContents],
        references: int,
        interfaces: Sequence[str] | None,
        rotate_bytes: int | None = None,
    ) -> None:
        """Create the first folder; `references` is how many instruments may talk."""
        self._out, self._kind, self._insoles, self._references = out, kind, tuple(insoles), references
        self._interfaces, self._rotate_bytes = interfaces, rotate_bytes
        self._finished_bytes = 0
        self.folders: list[Path] = []
        refuse_existing(out)
        self._durable = Durable()
        self._part = self._new_part()

    @property
    def size(self) -> int:
        """Bytes of readings so far, in all folders."""
        return self._finished_bytes + self._part.size()

    def write_frames(self, batch: FrameBatch) -> None:
        """Append frames to the log."""
        if len(batch) and self._part.candump is not None:
            self._guarded(partial(self._part.candump.write, batch))
            self._rotate_if_full()

    def note_dropped(self, count: int) -> None:
        """Write into the log that the kernel dropped `count` frames here."""
        if self._part.candump is not None:
            self._guarded(partial(self._part.candump.note_dropped, count))

    def write_cycle(self, foot: Foot, cycle: Mapping[str, Any]) -> None:
        """Append one cycle; the keys are those of counts.cycle_type."""
        growing = self._part.counts[foot]
        record = np.zeros(1, growing.dtype)
        for name in growing.dtype.names or ():
            record[name][0] = cycle[name]
        self._guarded(partial(growing.append, record))
        self._rotate_if_full()

    def write_reference(self, foot: Foot, clock: Clock, header: str, rows: str) -> None:
        """Append whole lines to the reference of `foot`; clock and header are the same every time."""
        file = self._part.references.get(foot)
        if file is None:
            file = self._guarded(partial(self._begin_reference, foot, clock, header))
        self._guarded(partial(file.write, rows.encode()))

    def close(self) -> None:
        """Finish every folder; raises FileError where the disk fails."""
        self._retire(self._part)
        self._guarded(self._durable.close)

    def _new_part(self) -> _Part:
        number = len(self.folders) + 1
        folder = self._out if number == 1 else self._out.with_name(f"{self._out.name}-{number}")
        refuse_existing(folder)
        return self._guarded(partial(self._create, folder))

    def _create(self, folder: Path) -> _Part:
        folder.mkdir(parents=True, exist_ok=True)
        self.folders.append(folder)
        said, invented = write_insoles(folder, self._insoles)
        part = _Part(folder, {"kind": "free"})
        if self._interfaces is not None:
            part.document["can"] = "can.log"
            part.log = open(folder / "can.log", "wb", buffering=0)  # noqa: SIM115
            part.candump = CandumpWriter(part.log, self._interfaces)
        else:
            part.document["counts"] = "counts"
            (folder / "counts").mkdir()
            for insole in self._insoles:
                part.counts[insole.foot] = GrowingCounts(folder / "counts" / f"{insole.foot}.npy", len(insole.layout))
        part.document |= {"can_origin": "recorded", "invented": invented or None, "insoles": said}
        part.write_document()
        for file in part.files():
            self._durable.watch(file)
        return part

    def _begin_reference(self, foot: Foot, clock: Clock, header: str) -> BinaryIO:
        part = self._part
        name = f"{foot}-reference.csv" if self._references > 1 else "reference.csv"
        file: BinaryIO = open(part.folder / name, "wb", buffering=0)  # noqa: SIM115
        file.write(header.encode())
        part.references[foot] = file
        part.document["kind"] = self._kind
        entry = {"foot": foot, "file": name, "clock": clock}
        part.document["reference"] = [*part.document.get("reference", ()), entry]
        part.write_document()
        self._durable.watch(file)
        return file

    def _rotate_if_full(self) -> None:
        if self._rotate_bytes is not None and self._part.size() >= self._rotate_bytes:
            full, self._part = self._part, self._new_part()
            self._retire(full)

    def _retire(self, part: _Part) -> None:
        self._finished_bytes += part.size()
        self._durable.retire(part.files(), partial(_pack, part))

    def _guarded(self, write: Callable[[], T]) -> T:
        """Do it; what the disk has to say becomes an FileError that names the folder."""
        try:
            self._durable.check()
            return write()
        except OSError as error:
            folder = self.folders[-1] if self.folders else self._out
            raise FileError(
                f"{folder}: recording failed: {error.strerror or error}; what was written before is kept. "
                "Check the disk's room and the folder's permissions"
            ) from error


def _pack(part: _Part) -> None:
    """The cycles of a finished folder into counts.npz; a kill in between leaves one or the other, whole."""
    if not part.counts:
        return
    sizes = {foot: growing.dtype["counts"].shape[0] for foot, growing in part.counts.items()}
    counted.write(part.folder / "counts.npz", counted.read(part.folder / "counts", sizes))
    part.document["counts"] = "counts.npz"
    part.write_document()
    shutil.rmtree(part.folder / "counts")


def record_of(raw: Any) -> dict[str, NDArray[Any] | int | bool]:
    """A cycle as LiveRecorder takes it, of a daemon's message of raw counts."""
    names = ("t_ns", "seq", "counts", "status", "age_ms", "missing", "valid", "late", "repeated")
    return {name: getattr(raw, name) for name in names}
