"""A whole recording written at once, for whoever knows all of it: a simulator, an importer.

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
from . import counts as counted
from . import reference as references
from .copies import InsoleContents, write_insoles
from .counts import CountsTable
from .document import FILE, CanOrigin, Clock, Kind, dump


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceContents:
    """The reference of one foot: columns (n,) by name, in the order of the file, time_s first if it is known."""

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
    """Write the recording `folder`, all or nothing; where it is.

    Its readings are one of: `frames`, which come in portions and go into the file `can` (.log or .log.gz); `log`, a
    candump log that is copied byte for byte; `counts` by foot. `source` names what it was made from.
    Raises FileError where the folder is already there or cannot be written.
    """
    path = Path(folder)
    if (frames is not None) + (log is not None) + (counts is not None) != 1:
        raise ValueError("expected one of frames, log and counts")
    with whole_folder(path) as unfinished:
        said, guessed = write_insoles(unfinished, insoles)
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
            counted.write(unfinished / "counts.npz", counts)
        document |= {
            "can_origin": can_origin,
            "invented": [*invented, *guessed] or None,
            "insoles": said,
            "reference": _write_references(unfinished, reference) or None,
            "extensions": {"source": source} if source is not None else None,
        }
        write_text(unfinished / FILE, dump(document))
    return path


def log_name(log: Path) -> str:
    """What a copy of a candump log is called: its ending tells how it is compressed."""
    with open(log, "rb") as file:
        head = file.read(4)
    return "can.log" + (".gz" if head[:2] == b"\x1f\x8b" else ".zst" if head == b"\x28\xb5\x2f\xfd" else "")


@contextlib.contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A folder beside `path` to write into, which becomes `path` in the end, or leaves nothing behind."""
    refuse_existing(path)
    unfinished = path.absolute().with_name(f".{path.name}.{os.getpid()}")
    try:
        unfinished.mkdir(parents=True)
        yield unfinished
        for file in unfinished.iterdir():
            with open(file, "rb") as opened:
                os.fsync(opened.fileno())
        with contextlib.suppress(FileNotFoundError):
            path.rmdir()  # it is empty
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
    """Raise FileError where `path` is there and is not an empty folder: no recording is ever overwritten."""
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise FileError(f"{path}: is already there; choose another name, no recording is overwritten")


def _write_references(folder: Path, contents: Sequence[ReferenceContents]) -> list[dict[str, str]]:
    said = []
    for each in contents:
        name = f"{each.foot}-reference.csv" if len(contents) > 1 else "reference.csv"
        write_text(folder / name, references.text(each.columns))
        said.append({"foot": each.foot, "file": name, "clock": each.clock})
    return said
