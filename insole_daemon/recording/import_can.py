"""Import CAN logs of other programs: candump byte for byte, all other formats through python-can."""

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

SUFFIXES = (".asc", ".blf", ".trc", ".csv", ".db", ".mf4", ".mdf")  # formats of python-can other than candump
_BATCH_FRAMES = 1 << 16


def import_candump(source: Path, out: Path, insoles: Sequence[InsoleContents] | None) -> Path:
    """Write the recording `out` with a copy of a candump log; LogError if it is not one."""
    with CandumpReader(source) as reader:
        seen = _board_addresses(reader.pieces())
    chosen = list(insoles) if insoles is not None else unknown_insoles(source, seen)
    return write(out, kind="free", can_origin="recorded", insoles=chosen, log=source, source=source.name)


def import_can(
    source: Path, out: Path, insoles: Sequence[InsoleContents] | None, progress: Callable[[float], None]
) -> Path:
    """Write the recording `out` from a log in a format of python-can; FileError if python-can cannot read it."""
    names: list[str] = []
    batches = list(_read_batches(source, names, progress))
    if not batches:
        raise FileError(f"{source}: expected a CAN log, found no frame in it")
    chosen = list(insoles) if insoles is not None else unknown_insoles(source, _board_addresses(batches))
    return write(
        out, kind="free", can_origin="recorded", insoles=chosen, frames=batches, interfaces=names, source=source.name
    )


def unknown_insoles(source: Path, addresses: set[int]) -> list[InsoleContents]:
    """Return the built-in configuration's insoles that have a board in `addresses`, with settings unknown.

    Raises FileError if a board is not in that configuration.
    """
    insoles = []
    for insole in Config().insoles:
        if addresses & set(insole.addresses):
            front, middle, rear = insole.addresses
            boards = [RecordedBoard(address=address) for address in insole.addresses]
            insoles.append(InsoleContents(insole.foot, boards, layouts.builtin(insole.foot, (front, middle, rear))))
    unknown_addresses = addresses - {address for configured in Config().insoles for address in configured.addresses}
    if unknown_addresses or not insoles:
        what = f"boards {', '.join(map(str, sorted(unknown_addresses)))}" if unknown_addresses else "no skin frames"
        raise FileError(
            f"{source}: expected frames of the boards 5 to 10 of the built-in configuration, found {what}: "
            "name the configuration it was recorded with, --config config.yaml"
        )
    return insoles


def _board_addresses(batches: Iterable[FrameBatch]) -> set[int]:
    """Return the addresses of the boards that sent halves."""
    addresses: set[int] = set()
    for batch in batches:
        skin = (batch.flags == 0) & np.isin(batch.can_id >> 8, (CLASS_SKIN, CLASS_LEGACY_SKIN)) & (batch.dlc == 8)
        addresses |= set((batch.can_id[skin] >> 4 & 0xF).tolist())
    return addresses


def _read_batches(source: Path, names: list[str], progress: Callable[[float], None]) -> Iterator[FrameBatch]:
    """Yield the frames in batches; appends each new interface to `names`."""
    import can

    rows: list[Any] = []
    try:
        with can.LogReader(source) as reader:
            for message in reader:
                rows.append(message)
                if len(rows) == _BATCH_FRAMES:
                    yield _to_batch(source, rows, names)
                    rows = []
                    progress(_fraction_read(reader))
            if rows:
                yield _to_batch(source, rows, names)
    except FileError:
        raise
    except Exception as error:  # every format raises different errors
        raise FileError(
            f"{source}: expected a log that python-can reads ({', '.join(SUFFIXES)}, candump), found that it cannot: "
            f"{type(error).__name__}: {error}"
        ) from error


def _fraction_read(reader: Any) -> float:
    """Return how much of its file python-can's reader has read, by the file position; 0 if it has no file."""
    try:
        descriptor = reader.file.fileno()
        return os.lseek(descriptor, 0, os.SEEK_CUR) / os.fstat(descriptor).st_size
    except (AttributeError, OSError):
        return 0.0


def _to_batch(source: Path, messages: Sequence[Any], names: list[str]) -> FrameBatch:
    """Convert python-can messages to frames; appends each new interface to `names`."""
    t_ns = np.array([round(message.timestamp * 1e6) for message in messages], np.int64) * 1000
    if (t_ns < 0).any():
        raise FileError(f"{source}: expected times from 1970 on, found {t_ns.min() / 1e9:.6f} s")
    interface = []
    for message in messages:
        name = _interface_name(message.channel)
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
    return batch[batch.flags & FD == 0]  # boards send no CAN FD, and can.log has no notation for it


def _interface_name(channel: Any) -> str:
    if channel is None:
        return "can0"
    return f"can{channel}" if isinstance(channel, int) or str(channel).isdigit() else "".join(str(channel).split())
