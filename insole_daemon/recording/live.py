"""Write a recording while it grows, so that a kill loses nothing and a power cut loses little.

Every portion goes to the kernel as soon as it arrives, so a killed recorder leaves all of it on disk. A thread syncs
the files to the disk twice a second, so the loop that reads frames never waits for the disk. The folder can be loaded
from its first second: recording.yaml is written before the first frame and says `kind: free` until a reference arrives.
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
from . import counts as counts_file
from .appended_lines import AppendedLines
from .copies import InsoleContents, write_insoles
from .counts import GrowingCounts
from .document import FILE, Clock, Kind, dump
from .writer import refuse_existing

_SYNC_S = 0.5
T = TypeVar("T")


class _OpenFile(Protocol):
    def fileno(self) -> int: ...
    def close(self) -> None: ...


class SyncThread:
    """Sync files to the disk in a thread, and run tasks that must wait for the disk in it."""

    def __init__(self) -> None:
        """Start the thread."""
        self._files: list[_OpenFile] = []
        self._tasks: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="durable", daemon=True)
        self._thread.start()

    def schedule(self, task: Callable[[], object]) -> None:
        """Run `task` within half a second, after all earlier tasks; return at once."""
        self._tasks.put(task)

    def watch(self, file: _OpenFile) -> None:
        """Sync what is written to `file` from now on."""
        self.schedule(partial(self._files.append, file))

    def retire(self, file: _OpenFile) -> None:
        """Close `file` after a last sync."""
        self.schedule(partial(self._retire, file))

    def raise_failure(self) -> None:
        """Raise the first error since the start: OSError if the disk failed."""
        if self._failure is not None:
            raise self._failure

    def close(self) -> None:
        """Finish all tasks and the thread, and raise the first error."""
        self._stop.set()
        self._thread.join()
        self.raise_failure()

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
        except Exception as error:  # raise_failure() raises it in the caller's thread
            self._failure = self._failure or error

    def _retire(self, file: _OpenFile) -> None:
        self._files.remove(file)
        _sync(file)
        file.close()


def _sync(file: _OpenFile) -> None:
    os.fdatasync(file.fileno())


@dataclass(slots=True)
class _OpenFolder:
    """The folder being written and its open files."""

    folder: Path
    document: dict[str, Any]
    log: AppendedLines | None = None
    candump: CandumpWriter | None = None
    counts: dict[str, GrowingCounts] = field(default_factory=dict)
    references: dict[str, AppendedLines] = field(default_factory=dict)

    def size(self) -> int:
        """Return the bytes of readings written so far."""
        return (self.log.tell() if self.log else 0) + sum(growing.size for growing in self.counts.values())

    def files(self) -> list[_OpenFile]:
        """Return every open file."""
        logs: list[_OpenFile] = [self.log] if self.log else []
        return [*logs, *self.counts.values(), *self.references.values()]

    def document_writer(self) -> Callable[[], None]:
        """Return a function that writes recording.yaml as it is now, for use in any thread."""
        return partial(write_text, self.folder / FILE, dump(self.document))


class LiveRecorder:
    """Write the folder `out`, and continue in out-2, out-3 … whenever a folder holds `rotate_bytes` of readings.

    With `interfaces` it records frames, without them cycles. Every folder is a complete recording. Raises FileError if
    a folder already exists or the disk fails.
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
        """Create the first folder; `references` is the number of reference instruments that may send readings."""
        self._out, self._kind, self._insoles, self._references = out, kind, tuple(insoles), references
        self._interfaces, self._rotate_bytes = interfaces, rotate_bytes
        self._finished_bytes = 0
        self.folders: list[Path] = []
        refuse_existing(out)
        self._sync_thread = SyncThread()
        self._prepared: queue.SimpleQueue[_OpenFolder] = queue.SimpleQueue()
        self._current = self._with_disk_errors(self._create_folder)
        self._is_preparing = False

    @property
    def size(self) -> int:
        """Return the bytes of readings so far, in all folders."""
        return self._finished_bytes + self._current.size()

    @property
    def folder(self) -> Path:
        """Return the folder that is being written."""
        return self._current.folder

    @property
    def insoles(self) -> tuple[InsoleContents, ...]:
        """Return the insoles that are recorded."""
        return self._insoles

    @property
    def feet(self) -> frozenset[Foot]:
        """Return the feet that are recorded."""
        return frozenset(insole.foot for insole in self._insoles)

    def write_frames(self, batch: FrameBatch) -> None:
        """Append frames to the log."""
        if len(batch) and self._current.candump is not None:
            self._with_disk_errors(partial(self._current.candump.write, batch))
            self._rotate_if_full()

    def note_dropped(self, count: int) -> None:
        """Note in the log that the kernel dropped `count` frames at this point."""
        if self._current.candump is not None:
            self._with_disk_errors(partial(self._current.candump.note_dropped, count))

    def note(self, name: str, value: Any) -> None:
        """Set `name` to `value` under `extensions` of the current recording.yaml."""
        extensions = self._current.document.setdefault("extensions", {})
        if extensions.get(name) != value:
            extensions[name] = value
            self._sync_thread.schedule(self._current.document_writer())

    def write_cycle(self, foot: Foot, cycle: Mapping[str, Any]) -> None:
        """Append one cycle with the keys of counts.cycle_type; FileError if its number of triangles has changed."""
        growing = self._current.counts[foot]
        if cycle["counts"].shape != growing.dtype["counts"].shape:
            raise FileError(
                f"{self.folders[-1]}: expected cycles of {growing.dtype['counts'].shape[0]} triangles, found "
                f"{cycle['counts'].shape[0]}: the daemon was restarted with another layout; record anew"
            )
        record = np.zeros(1, growing.dtype)
        for name in growing.dtype.names or ():
            record[name][0] = cycle[name]
        self._with_disk_errors(partial(growing.append, record))
        self._rotate_if_full()

    def write_reference(self, foot: Foot, clock: Clock, header: str, rows: str) -> None:
        """Append whole lines to the reference of `foot`; `clock` and `header` must be the same at every call."""
        file = self._current.references.get(foot)
        if file is None:
            file = self._with_disk_errors(partial(self._create_reference, foot, clock, header))
        self._with_disk_errors(partial(file.write, rows.encode()))

    def mark(self, t_ns: int, text: str) -> None:
        """Add a marker with its time (CLOCK_REALTIME) and text to `extensions.markers` of recording.yaml."""
        markers = self._current.document.setdefault("extensions", {}).setdefault("markers", [])
        markers.append({"t_ns": t_ns, "text": text})
        self._sync_thread.schedule(self._current.document_writer())

    def close(self) -> None:
        """Finish every folder; FileError if the disk fails."""
        self._retire(self._current)
        self._with_disk_errors(self._sync_thread.close)
        if not self._prepared.empty():  # prepared for a rotation that did not come
            unused = self._prepared.get()
            for file in unused.files():
                file.close()
            shutil.rmtree(unused.folder, ignore_errors=True)
            self.folders.remove(unused.folder)

    def _create_folder(self) -> _OpenFolder:
        """Create the next folder with its files, and watch them."""
        folder = self._out
        number = len(self.folders)
        while number and (folder in self.folders or folder.exists()):  # skip folders of an earlier recording
            number += 1
            folder = self._out.with_name(f"{self._out.name}-{number}")
        self.folders.append(folder)
        unfinished = folder.absolute().with_name(f".{folder.name}.{os.getpid()}")
        try:
            created = self._create_contents(unfinished)
            os.rename(unfinished, folder)  # after a kill the folder is complete or absent
        except BaseException:
            shutil.rmtree(unfinished, ignore_errors=True)
            raise
        created.folder = folder
        for file in created.files():
            self._sync_thread.watch(file)
        return created

    def _create_contents(self, folder: Path) -> _OpenFolder:
        """Create an empty but complete recording in `folder`."""
        folder.mkdir(parents=True)
        entries, invented = write_insoles(folder, self._insoles)
        created = _OpenFolder(folder, {"kind": "free"})
        if self._interfaces is not None:
            created.document["can"] = "can.log"
            created.log = AppendedLines(folder / "can.log")
            created.candump = CandumpWriter(cast(BinaryIO, created.log), self._interfaces)
        else:
            created.document["counts"] = "counts"
            (folder / "counts").mkdir()
            for insole in self._insoles:
                created.counts[insole.foot] = GrowingCounts(
                    folder / "counts" / f"{insole.foot}.npy", len(insole.layout)
                )
        created.document |= {"can_origin": "recorded", "invented": invented or None, "insoles": entries}
        created.document_writer()()
        return created

    def _create_reference(self, foot: Foot, clock: Clock, header: str) -> AppendedLines:
        """Create the reference file of `foot` and name it in recording.yaml."""
        current = self._current
        name = f"{foot}-reference.csv" if self._references > 1 else "reference.csv"
        file = AppendedLines(current.folder / name)
        file.write(header.encode())
        current.references[foot] = file
        current.document["kind"] = self._kind
        entry = {"foot": foot, "file": name, "clock": clock}
        current.document["reference"] = [*current.document.get("reference", ()), entry]
        self._sync_thread.schedule(current.document_writer())
        self._sync_thread.watch(file)
        return file

    def _rotate_if_full(self) -> None:
        """Switch to the next folder once it is prepared; the sync thread prepares it, since that waits for the disk."""
        if self._rotate_bytes is None or self._current.size() < self._rotate_bytes:
            return
        if not self._is_preparing:
            self._is_preparing = True
            self._sync_thread.schedule(lambda: self._prepared.put(self._create_folder()))
        elif not self._prepared.empty():
            full, self._current = self._current, self._prepared.get()
            self._is_preparing = False
            self._retire(full)

    def _retire(self, finished: _OpenFolder) -> None:
        self._finished_bytes += finished.size()
        for file in finished.files():
            self._sync_thread.retire(file)
        self._sync_thread.schedule(partial(_pack, finished))

    def _with_disk_errors(self, write: Callable[[], T]) -> T:
        """Call `write`, and turn an OSError into a FileError that names the folder."""
        try:
            self._sync_thread.raise_failure()
            return write()
        except OSError as error:
            folder = self.folders[-1] if self.folders else self._out
            raise FileError(
                f"{folder}: recording failed: {error.strerror or error}; what was written before is kept. "
                "Check the disk's room and the folder's permissions"
            ) from error


def _pack(finished: _OpenFolder) -> None:
    """Pack the cycles of a finished folder into counts.npz; a kill leaves either the folder or the file intact."""
    if not finished.counts:
        return
    sizes = {foot: growing.dtype["counts"].shape[0] for foot, growing in finished.counts.items()}
    counts_file.write(finished.folder / "counts.npz", counts_file.read(finished.folder / "counts", sizes))
    finished.document["counts"] = "counts.npz"
    finished.document_writer()()
    shutil.rmtree(finished.folder / "counts")


def cycle_record(message: Any) -> dict[str, NDArray[Any] | int | bool]:
    """Return the cycle in a daemon's `raw` message, as LiveRecorder.write_cycle takes it."""
    names = ("t_ns", "seq", "counts", "status", "age_ms", "missing", "valid", "late", "repeated")
    return {name: getattr(message, name) for name in names}
