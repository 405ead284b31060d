"""CAN logs of other programs into a recording: candump byte for byte, everything else through python-can."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..bus.candump import CandumpReader
from ..bus.frames import ERROR, EXTENDED, FD, REMOTE, FrameBatch
from ..config import Config
from ..errors import FileError
from ..skin import layout as layouts
from ..skin.identifiers import CLASS_LEGACY_SKIN, CLASS_SKIN
from .copies import InsoleContents
from .document import RecordedBoard
from .writer import write

SUFFIXES = (".asc", ".blf", ".trc", ".csv", ".db", ".mf4", ".mdf")  # of what python-can reads, beside candump
_AT_ONCE = 1 << 16


def import_candump(source: Path, out: Path, insoles: Sequence[InsoleContents] | None) -> Path:
    """Write the recording `out` with a copy of a candump log; LogError where it is none."""
    with CandumpReader(source) as reader:
        seen = _seen(reader.pieces())
    chosen = list(insoles) if insoles is not None else unknown_insoles(source, seen)
    return write(out, kind="free", can_origin="recorded", insoles=chosen, log=source, source=source.name)


def import_can(
    source: Path, out: Path, insoles: Sequence[InsoleContents] | None, progress: Callable[[float], None]
) -> Path:
    """Write the recording `out` of a log that python-can reads; FileError where it cannot."""
    names: list[str] = []
    batches = list(_batches(source, names, progress))
    if not batches:
        raise FileError(f"{source}: expected a CAN log, found no frame in it")
    chosen = list(insoles) if insoles is not None else unknown_insoles(source, _seen(batches))
    return write(
        out, kind="free", can_origin="recorded", insoles=chosen, frames=batches, interfaces=names, source=source.name
    )


def unknown_insoles(source: Path, seen: set[int]) -> list[InsoleContents]:
    """The insoles of the built-in configuration whose boards are among the addresses `seen`; settings not known."""
    found = []
    for insole in Config().insoles:
        if seen & set(insole.addresses):
            front, middle, rear = insole.addresses
            boards = [RecordedBoard(address=address) for address in insole.addresses]
            found.append(InsoleContents(insole.foot, boards, layouts.builtin(insole.foot, (front, middle, rear))))
    strangers = seen - {address for each in Config().insoles for address in each.addresses}
    if strangers or not found:
        what = f"boards {', '.join(map(str, sorted(strangers)))}" if strangers else "no skin frames"
        raise FileError(
            f"{source}: expected frames of the boards 5 to 10 of the built-in configuration, found {what}: "
            "name the configuration it was recorded with, --config config.yaml"
        )
    return found


def _seen(batches: Iterable[FrameBatch]) -> set[int]:
    """Addresses of the boards that sent halves."""
    seen: set[int] = set()
    for batch in batches:
        skin = (batch.flags == 0) & np.isin(batch.can_id >> 8, (CLASS_SKIN, CLASS_LEGACY_SKIN)) & (batch.dlc == 8)
        seen |= set((batch.can_id[skin] >> 4 & 0xF).tolist())
    return seen


def _batches(source: Path, names: list[str], progress: Callable[[float], None]) -> Iterator[FrameBatch]:
    """The frames in portions; `names` fills up with the interfaces as they appear."""
    import can

    rows: list[Any] = []
    try:
        with can.LogReader(source) as reader:
            for message in reader:
                rows.append(message)
                if len(rows) == _AT_ONCE:
                    yield _batch(source, rows, names)
                    rows = []
                    progress(_share_read(reader))
            if rows:
                yield _batch(source, rows, names)
    except FileError:
        raise
    except Exception as error:  # every format has errors of its own
        raise FileError(
            f"{source}: expected a log that python-can reads ({', '.join(SUFFIXES)}, candump), found that it cannot: "
            f"{type(error).__name__}: {error}"
        ) from error


def _share_read(reader: Any) -> float:
    """How much of its file a reader of python-can has read, by the position in it; 0 where it does not say."""
    try:
        descriptor = reader.file.fileno()
        return os.lseek(descriptor, 0, os.SEEK_CUR) / os.fstat(descriptor).st_size
    except (AttributeError, OSError):
        return 0.0


def _batch(source: Path, messages: Sequence[Any], names: list[str]) -> FrameBatch:
    t_ns = np.array([round(message.timestamp * 1e6) for message in messages], np.int64) * 1000
    if (t_ns < 0).any():
        raise FileError(f"{source}: expected times from 1970 on, found {t_ns.min() / 1e9:.6f} s")
    interface = []
    for message in messages:
        name = _name(message.channel)
        if name not in names:
            names.append(name)
        interface.append(names.index(name))
    flags = [
        EXTENDED * bool((m.is_extended_id or m.arbitration_id > 0x7FF) and not m.is_error_frame)
        | REMOTE * bool(m.is_remote_frame)
        | ERROR * bool(m.is_error_frame)
        | FD * bool(m.is_fd)
        for m in messages
    ]
    data = b"".join(bytes(message.data[:8]).ljust(8, b"\0") for message in messages)
    batch = FrameBatch(
        t_ns,
        np.maximum.accumulate(t_ns),
        np.array(interface, np.uint8),
        np.array([message.arbitration_id & 0x1FFF_FFFF for message in messages], np.uint32),
        np.array([message.dlc for message in messages], np.uint8),
        np.frombuffer(data, np.uint8).reshape(-1, 8),
        np.array(flags, np.uint8),
    )
    return batch[batch.flags & FD == 0]  # the insole sends none, and a log of ours holds none


def _name(channel: Any) -> str:
    if channel is None:
        return "can0"
    return f"can{channel}" if isinstance(channel, int) or str(channel).isdigit() else "".join(str(channel).split())
