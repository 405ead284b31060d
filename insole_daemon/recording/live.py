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
from typing import Any, BinaryIO, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from ..bus.candump_writer import CandumpWriter
from ..bus.frames import FrameBatch
from ..config import Foot
from ..errors import FileError
from ..files import write_text
from . import counts as counted
from .appending import AppendedLines
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
    """Makes files durable in a thread of its own, and does there whatever else must wait for a disk."""

    def __init__(self) -> None:
        """Begin."""
        self._files: list[_OpenFile] = []
        self._tasks: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._failed: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="durable", daemon=True)
        self._thread.start()

    def do(self, task: Callable[[], object]) -> None:
        """Do `task` within half a second, after all that was asked for before; returns at once."""
        self._tasks.put(task)

    def watch(self, file: _OpenFile) -> None:
        """Make what is written to `file` durable from now on."""
        self.do(partial(self._files.append, file))

    def retire(self, file: _OpenFile) -> None:
        """Close `file` once it is durable."""
        self.do(partial(self._retire, file))

    def check(self) -> None:
        """Raise what has failed since: OSError where it was the disk."""
        if self._failed is not None:
            raise self._failed

    def close(self) -> None:
        """Finish everything; raises what has failed."""
        self._stop.set()
        self._thread.join()
        self.check()

    def _run(self) -> None:
        stopping = False
        while not stopping:
            stopping = self._stop.wait(_SYNC_S)
            while not self._tasks.empty():
                self._attempt(self._tasks.get())
            for file in self._files:
                self._attempt(partial(_sync, file))

    def _attempt(self, task: Callable[[], object]) -> None:
        try:
            task()
        except Exception as error:  # told by check(), in the thread that can say it
            self._failed = self._failed or error

    def _retire(self, file: _OpenFile) -> None:
        self._files.remove(file)
        _sync(file)
        file.close()


def _sync(file: _OpenFile) -> None:
    os.fdatasync(file.fileno())


@dataclass(slots=True)
class _Part:
    """One folder and its open files."""

    folder: Path
    document: dict[str, Any]
    log: AppendedLines | None = None
    candump: CandumpWriter | None = None
    counts: dict[str, GrowingCounts] = field(default_factory=dict)
    references: dict[str, AppendedLines] = field(default_factory=dict)

    def size(self) -> int:
        return (self.log.tell() if self.log else 0) + sum(each.size for each in self.counts.values())

    def files(self) -> list[_OpenFile]:
        logs: list[_OpenFile] = [self.log] if self.log else []
        return [*logs, *self.counts.values(), *self.references.values()]

    def writing_document(self) -> Callable[[], None]:
        """What writes recording.yaml as it is to be now, in whichever thread."""
        return partial(write_text, self.folder / FILE, dump(self.document))


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
        self._next: queue.SimpleQueue[_Part] = queue.SimpleQueue()
        self._part = self._guarded(self._new_part)
        self._preparing = False

    @property
    def size(self) -> int:
        """Bytes of readings so far, in all folders."""
        return self._finished_bytes + self._part.size()

    @property
    def folder(self) -> Path:
        """The folder that is written now."""
        return self._part.folder

    @property
    def insoles(self) -> tuple[InsoleContents, ...]:
        """The insoles that are recorded."""
        return self._insoles

    @property
    def feet(self) -> frozenset[Foot]:
        """The feet that are recorded."""
        return frozenset(insole.foot for insole in self._insoles)

    def write_frames(self, batch: FrameBatch) -> None:
        """Append frames to the log."""
        if len(batch) and self._part.candump is not None:
            self._guarded(partial(self._part.candump.write, batch))
            self._rotate_if_full()

    def note_dropped(self, count: int) -> None:
        """Write into the log that the kernel dropped `count` frames here."""
        if self._part.candump is not None:
            self._guarded(partial(self._part.candump.note_dropped, count))

    def note(self, name: str, value: Any) -> None:
        """Say `value` under the `extensions` of the recording.yaml that is written now."""
        extensions = self._part.document.setdefault("extensions", {})
        if extensions.get(name) != value:
            extensions[name] = value
            self._durable.do(self._part.writing_document())

    def write_cycle(self, foot: Foot, cycle: Mapping[str, Any]) -> None:
        """Append one cycle; the keys are those of counts.cycle_type."""
        growing = self._part.counts[foot]
        if cycle["counts"].shape != growing.dtype["counts"].shape:
            raise FileError(
                f"{self.folders[-1]}: expected cycles of {growing.dtype['counts'].shape[0]} triangles, found "
                f"{cycle['counts'].shape[0]}: the daemon was restarted with another layout; record anew"
            )
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

    def mark(self, t_ns: int, text: str) -> None:
        """Note a moment (CLOCK_REALTIME) and what a person says of it: `extensions.markers` of recording.yaml."""
        markers = self._part.document.setdefault("extensions", {}).setdefault("markers", [])
        markers.append({"t_ns": t_ns, "text": text})
        self._durable.do(self._part.writing_document())

    def close(self) -> None:
        """Finish every folder; raises FileError where the disk fails."""
        self._retire(self._part)
        self._guarded(self._durable.close)
        if not self._next.empty():  # it was made and never used
            unused = self._next.get()
            for file in unused.files():
                file.close()
            shutil.rmtree(unused.folder, ignore_errors=True)
            self.folders.remove(unused.folder)

    def _new_part(self) -> _Part:
        folder = self._out
        number = len(self.folders)
        while number and (folder in self.folders or folder.exists()):  # of an earlier recording: this one goes on
            number += 1
            folder = self._out.with_name(f"{self._out.name}-{number}")
        self.folders.append(folder)
        unfinished = folder.absolute().with_name(f".{folder.name}.{os.getpid()}")
        try:
            part = self._unfinished_part(unfinished)
            os.rename(unfinished, folder)  # a kill leaves a whole folder of this name, or none
        except BaseException:
            shutil.rmtree(unfinished, ignore_errors=True)
            raise
        part.folder = folder
        for file in part.files():
            self._durable.watch(file)
        return part

    def _unfinished_part(self, folder: Path) -> _Part:
        folder.mkdir(parents=True)
        said, invented = write_insoles(folder, self._insoles)
        part = _Part(folder, {"kind": "free"})
        if self._interfaces is not None:
            part.document["can"] = "can.log"
            part.log = AppendedLines(folder / "can.log")
            part.candump = CandumpWriter(cast(BinaryIO, part.log), self._interfaces)
        else:
            part.document["counts"] = "counts"
            (folder / "counts").mkdir()
            for insole in self._insoles:
                part.counts[insole.foot] = GrowingCounts(folder / "counts" / f"{insole.foot}.npy", len(insole.layout))
        part.document |= {"can_origin": "recorded", "invented": invented or None, "insoles": said}
        part.writing_document()()
        return part

    def _begin_reference(self, foot: Foot, clock: Clock, header: str) -> AppendedLines:
        part = self._part
        name = f"{foot}-reference.csv" if self._references > 1 else "reference.csv"
        file = AppendedLines(part.folder / name)
        file.write(header.encode())
        part.references[foot] = file
        part.document["kind"] = self._kind
        entry = {"foot": foot, "file": name, "clock": clock}
        part.document["reference"] = [*part.document.get("reference", ()), entry]
        self._durable.do(part.writing_document())
        self._durable.watch(file)
        return file

    def _rotate_if_full(self) -> None:
        """Go on in the next folder once it is there: making it waits for the disk, which the readings must not."""
        if self._rotate_bytes is None or self._part.size() < self._rotate_bytes:
            return
        if not self._preparing:
            self._preparing = True
            self._durable.do(lambda: self._next.put(self._new_part()))
        elif not self._next.empty():
            full, self._part = self._part, self._next.get()
            self._preparing = False
            self._retire(full)

    def _retire(self, part: _Part) -> None:
        self._finished_bytes += part.size()
        for file in part.files():
            self._durable.retire(file)
        self._durable.do(partial(_pack, part))

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
    part.writing_document()()
    shutil.rmtree(part.folder / "counts")


def record_of(raw: Any) -> dict[str, NDArray[Any] | int | bool]:
    """A cycle as LiveRecorder takes it, of a daemon's message of raw counts."""
    names = ("t_ns", "seq", "counts", "status", "age_ms", "missing", "valid", "late", "repeated")
    return {name: getattr(raw, name) for name in names}
