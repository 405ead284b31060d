"""Which importer a file is for: by its name and how it begins."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from ..config import Foot
from ..errors import FileError
from ..files import unreadable
from ..skin.layout import Layout
from .copies import InsoleContents
from .import_bench import import_bench
from .import_can import SUFFIXES, import_can, import_candump
from .import_matlab import import_matlab
from .import_mcap import import_mcap
from .import_yarp import import_yarp

HEAD_BYTES = 64  # by which formats are told apart


def import_recording(
    source: Path,
    out: Path,
    foot: Foot | None,
    layout: Layout | None,
    insoles: Sequence[InsoleContents] | None,
    progress: Callable[[float], None] = lambda share: None,
) -> Path:
    """Write the recording `out` of whatever `source` is; FileError where it is nothing known.

    `foot` and `layout` are those of tables of counts, `insoles` of CAN logs. `progress` is told the share that is read
    of a log that python-can reads: nothing else takes long.
    """
    if not source.exists():
        raise FileError(f"{source}: is not there: expected a file to import; check the path")
    suffix, head = source.suffix.lower(), _head(source)
    if suffix == ".mcap":
        return import_mcap(source, out)
    if suffix == ".csv" and not head.startswith(b"timestamp,arbitration_id"):
        return import_bench(source, out, _of(foot, source), layout)
    if suffix == ".mat":
        return import_matlab(source, out, _of(foot, source), layout)
    if suffix in SUFFIXES or (suffix == ".gz" and Path(source.stem).suffix.lower() in SUFFIXES):
        return import_can(source, out, insoles, progress)
    if source.is_dir() or head[:1].isdigit():
        return import_yarp(source, out, foot, layout)
    return import_candump(source, out, insoles)


def _head(source: Path) -> bytes:
    if source.is_dir():
        return b""
    try:
        # Without a buffer, whose loop of reads no signal ends once it has begun: a pipe may give little at a time.
        with open(source, "rb", buffering=0) as file:
            head = b""
            while len(head) < HEAD_BYTES and (more := file.read(HEAD_BYTES - len(head))):
                head += more
            return head
    except OSError as error:
        raise FileError(f"{source}: {unreadable(error)}") from error


def _of(foot: Foot | None, source: Path) -> Foot:
    if foot is None:
        raise FileError(f"{source}: does not say whose insole it is: say --foot left or --foot right")
    return foot
