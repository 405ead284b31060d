"""Write batches of frames as a candump log: the bytes that `candump -L` would have printed."""

from __future__ import annotations

import gzip
import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Final, Self, cast

import numpy as np
from numpy.typing import NDArray

from ..errors import LogError
from .candump_line import interface_name
from .frames import ERROR, EXTENDED, FD, REMOTE, FrameBatch

_ERROR_FLAG = np.uint32(0x2000_0000)  # CAN_ERR_FLAG of linux/can.h
_TIME_POWERS: Final = 10 ** np.arange(15, -1, -1, dtype=np.int64)  # 10 digits of seconds, 6 of microseconds
_ROWS_AT_ONCE = 1 << 13  # so that their text stays in the cache
_HEX = np.frombuffer(b"0123456789ABCDEF", np.uint8)


class CandumpWriter:
    """Writes the frames of a source whose `interfaces` are given; times are rounded down to microseconds.

        with CandumpWriter("can.log", ("can0",)) as log:
            log.write(batch)

    Names are padded to the longest, as candump does. A path that ends in .gz is compressed. A stream is flushed in the
    end, and the caller closes it.
    """

    def __init__(self, path_or_stream: str | os.PathLike[str] | BinaryIO, interfaces: Sequence[str]) -> None:
        """Create or overwrite the file; raises LogError if it cannot be written."""
        self.interfaces = tuple(interfaces)
        for name in self.interfaces:
            if interface_name(name.encode()) is None:
                raise LogError(f"expected the name of an interface, as can0, found {name!r}: a log cannot hold it")
        self._owned = isinstance(path_or_stream, str | os.PathLike)
        self.path = os.fspath(cast(str, path_or_stream)) if self._owned else "the log"
        self._stream = _create(self.path) if self._owned else cast(BinaryIO, path_or_stream)
        self._dropped = 0
        width = max((len(name.encode()) for name in self.interfaces), default=0)
        # ") can0 " for each interface, one row each
        self._names = np.array(
            [list(b") " + name.encode().rjust(width) + b" ") for name in self.interfaces], np.uint8
        ).reshape(len(self.interfaces), width + 3)

    def write(self, batch: FrameBatch) -> None:
        """Append the frames; raises LogError for frames that a classic candump log cannot hold."""
        self._check(batch)
        for first in range(0, len(batch), _ROWS_AT_ONCE):
            self._stream.write(self._text(batch[first : first + _ROWS_AT_ONCE]))

    def note_dropped(self, count: int) -> None:
        """Append a note that the kernel dropped `count` frames, as `candump -d` does."""
        self._dropped += count
        frames = "frame" if count == 1 else "frames"
        interface = self.interfaces[0] if len(self.interfaces) == 1 else "any"
        note = f"DROPCOUNT: dropped {count} CAN {frames} on '{interface}' socket (total drops {self._dropped})\n"
        self._stream.write(note.encode())

    def close(self) -> None:
        """Flush, and close what this writer opened; idempotent."""
        if self._owned:
            self._stream.close()
        else:
            self._stream.flush()

    def __enter__(self) -> Self:
        """Return the writer."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the writer."""
        self.close()

    def _check(self, batch: FrameBatch) -> None:
        if np.any(batch.flags & FD):
            raise LogError(
                f"{self.path}: expected classic CAN frames, found CAN FD, of which a batch holds "
                "only the first 8 bytes; record CAN FD with 'candump -l'"
            )
        if len(batch) and int(batch.interface.max()) >= len(self.interfaces):
            raise LogError(
                f"{self.path}: expected frames of {len(self.interfaces)} interfaces, "
                f"found index {batch.interface.max()}; open the log with all interfaces of the source"
            )
        if np.any(batch.dlc > 8) or np.any(batch.t_ns < 0):
            raise LogError(
                f"{self.path}: expected times from 1970 on and at most 8 bytes, "
                f"found t_ns {batch.t_ns.min()} and dlc {batch.dlc.max()}; such a batch comes from no bus"
            )

    def _text(self, batch: FrameBatch) -> bytes:
        """Return the lines: a table of characters at fixed columns, without those that a frame does not have."""
        n, named = len(batch), 18 + self._names.shape[1]
        identifier, payload = named, named + 9
        text = np.full((n, payload + 17), ord("\n"), np.uint8)
        has = np.ones(text.shape, np.bool_)

        text[:, 0] = ord("(")
        digits = (batch.t_ns // 1000)[:, None] // _TIME_POWERS % 10 + ord("0")
        text[:, 1:11], text[:, 11], text[:, 12:18] = digits[:, :10], ord("."), digits[:, 10:]
        text[:, 18:named] = self._names[batch.interface]

        error = (batch.flags & ERROR) != 0
        long = error | ((batch.flags & EXTENDED) != 0)
        can_id = batch.can_id | np.where(error, _ERROR_FLAG, np.uint32(0))
        text[:, identifier : identifier + 8] = _hexadecimal(can_id.astype(">u4").view(np.uint8).reshape(n, 4))
        text[:, identifier + 8] = ord("#")
        has[:, identifier : identifier + 5] = long[:, None]

        text[:, payload : payload + 16] = _hexadecimal(batch.data)
        length = 2 * batch.dlc.astype(np.intp)
        remote = (batch.flags & REMOTE) != 0
        if remote.any():
            text[remote, payload] = ord("R")
            text[remote, payload + 1] = ord("0") + batch.dlc[remote]
            length[remote] = 1 + (batch.dlc[remote] > 0)
        has[:, payload:-1] = np.arange(16) < length[:, None]
        return text[has].tobytes()


def _hexadecimal(binary: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the (n, 2 k) hexadecimal characters of (n, k) bytes."""
    return np.stack([_HEX[binary >> 4], _HEX[binary & 15]], axis=-1).reshape(len(binary), -1)


def _create(path: str) -> BinaryIO:
    suffix = Path(path).suffix.lower()
    if suffix == ".zst":
        raise LogError(f"{path}: expected a path that ends in .log or .log.gz; compress with zstd afterwards")
    try:
        return cast(BinaryIO, gzip.open(path, "wb")) if suffix == ".gz" else open(path, "wb")
    except OSError as error:
        raise LogError(
            f"{path}: expected to create a log, found that it cannot be ({error.strerror}); "
            "check that the folder exists and may be written to"
        ) from error
