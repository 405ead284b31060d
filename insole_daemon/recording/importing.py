"""Choose the importer of a file by its name and first bytes."""

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

HEAD_BYTES = 64  # read to recognise the format


def import_recording(
    source: Path,
    out: Path,
    foot: Foot | None,
    layout: Layout | None,
    insoles: Sequence[InsoleContents] | None,
    progress: Callable[[float], None] = lambda share: None,
) -> Path:
    """Write the recording `out` from a file in any supported format; FileError if the format is unknown.

    `foot` and `layout` apply to tables of counts, `insoles` to CAN logs. `progress` is called with the fraction read,
    only for logs that python-can reads: the other formats are fast.
    """
    if not source.exists():
        raise FileError(f"{source}: does not exist: expected a file to import; check the path")
    suffix, head = source.suffix.lower(), _read_head(source)
    if suffix == ".mcap":
        return import_mcap(source, out)
    if suffix == ".csv" and not head.startswith(b"timestamp,arbitration_id"):
        return import_bench(source, out, _require_foot(foot, source), layout)
    if suffix == ".mat":
        return import_matlab(source, out, _require_foot(foot, source), layout)
    if suffix in SUFFIXES or (suffix == ".gz" and Path(source.stem).suffix.lower() in SUFFIXES):
        return import_can(source, out, insoles, progress)
    if source.is_dir() or head[:1].isdigit():
        return import_yarp(source, out, foot, layout)
    return import_candump(source, out, insoles)


def _read_head(source: Path) -> bytes:
    """Return the first bytes of a file; empty for a folder."""
    if source.is_dir():
        return b""
    try:
        # Unbuffered: a buffered read of a slow pipe loops inside C, where no signal interrupts it.
        with open(source, "rb", buffering=0) as file:
            head = b""
            while len(head) < HEAD_BYTES and (more := file.read(HEAD_BYTES - len(head))):
                head += more
            return head
    except OSError as error:
        raise FileError(f"{source}: {unreadable(error)}") from error


def _require_foot(foot: Foot | None, source: Path) -> Foot:
    if foot is None:
        raise FileError(f"{source}: does not state the foot: give --foot left or --foot right")
    return foot
