"""Write a complete recording at once, for a simulator or an importer.

write("trial-1", kind="chamber", can_origin="simulated", insoles=[InsoleContents(…)],
      frames=batches, interfaces=("can0",), reference=[ReferenceContents("left", "can", {"time_s": …, …})])
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bus.candump_writer import CandumpWriter
from ..bus.frames import FrameBatch
from ..config import Foot
from ..errors import FileError
from ..files import write_text
from . import counts as counts_file
from . import reference as references
from .copies import InsoleContents, write_insoles
from .counts import CountsTable
from .document import FILE, CanOrigin, Clock, Kind, dump


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceContents:
    """The reference of one foot: columns (n,) by name, in the order of the file, with time_s first if it is known."""

    foot: Foot
    clock: Clock
    columns: Mapping[str, NDArray[np.float64]]


def write(
    folder: str | os.PathLike[str],
    *,
    kind: Kind,
    can_origin: CanOrigin,
    insoles: Sequence[InsoleContents],
    frames: Iterable[FrameBatch] | None = None,
    interfaces: Sequence[str] = ("can0",),
    can: str = "can.log",
    log: Path | None = None,
    counts: Mapping[str, CountsTable] | None = None,
    reference: Sequence[ReferenceContents] = (),
    invented: Sequence[str] = (),
    source: str | None = None,
) -> Path:
    """Write the recording `folder`, all or nothing, and return its path.

    Give exactly one source of readings: `frames`, batches that are written to the file `can` (.log or .log.gz); `log`,
    a candump log that is copied byte for byte; or `counts`, a table by foot. `source` names the file it was made from.
    Raises FileError if the folder exists already or cannot be written.
    """
    path = Path(folder)
    if (frames is not None) + (log is not None) + (counts is not None) != 1:
        raise ValueError("expected one of frames, log and counts")
    with whole_folder(path) as unfinished:
        entries, invented_contents = write_insoles(unfinished, insoles)
        document: dict[str, Any] = {"kind": kind}
        if frames is not None:
            document["can"] = can
            with CandumpWriter(unfinished / can, interfaces) as writer:
                for batch in frames:
                    writer.write(batch)
        elif log is not None:
            document["can"] = log_name(log)
            shutil.copyfile(log, unfinished / document["can"])
        elif counts is not None:
            document["counts"] = "counts.npz"
            counts_file.write(unfinished / "counts.npz", counts)
        document |= {
            "can_origin": can_origin,
            "invented": [*invented, *invented_contents] or None,
            "insoles": entries,
            "reference": _write_references(unfinished, reference) or None,
            "extensions": {"source": source} if source is not None else None,
        }
        write_text(unfinished / FILE, dump(document))
    return path


def log_name(log: Path) -> str:
    """Return the file name for a copy of a candump log; its suffix states the compression."""
    with open(log, "rb") as file:
        head = file.read(4)
    return "can.log" + (".gz" if head[:2] == b"\x1f\x8b" else ".zst" if head == b"\x28\xb5\x2f\xfd" else "")


@contextlib.contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder beside `path`, and rename it to `path` at the end or delete it after an error."""
    refuse_existing(path)
    unfinished = path.absolute().with_name(f".{path.name}.{os.getpid()}")
    try:
        unfinished.mkdir(parents=True)
        yield unfinished
        for file in unfinished.iterdir():
            with open(file, "rb") as opened:
                os.fsync(opened.fileno())
        with contextlib.suppress(FileNotFoundError):
            path.rmdir()  # refuse_existing() allows an empty folder
        os.rename(unfinished, path)
    except OSError as error:
        shutil.rmtree(unfinished, ignore_errors=True)
        raise FileError(
            f"{path}: expected to write a recording, found that it cannot be ({error.strerror or error}); "
            "check the disk's room and the folder's permissions"
        ) from error
    except BaseException:
        shutil.rmtree(unfinished, ignore_errors=True)
        raise


def refuse_existing(path: Path) -> None:
    """Raise FileError if `path` exists and is not an empty folder: no recording is ever overwritten."""
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise FileError(f"{path}: is already there; choose another name, no recording is overwritten")


def _write_references(folder: Path, contents: Sequence[ReferenceContents]) -> list[dict[str, str]]:
    """Write the reference files, and return their entries in recording.yaml."""
    entries = []
    for reference in contents:
        name = f"{reference.foot}-reference.csv" if len(contents) > 1 else "reference.csv"
        write_text(folder / name, references.text(reference.columns))
        entries.append({"foot": reference.foot, "file": name, "clock": reference.clock})
    return entries
