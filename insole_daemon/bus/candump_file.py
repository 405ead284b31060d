"""Read the bytes of a log file: plain, gzip or zstd, recognised by its first bytes and not by its name."""

from __future__ import annotations

import importlib
import os
import zlib
from collections.abc import Callable
from typing import Any, Final, Protocol, cast

from ..errors import LogError

_GZIP = b"\x1f\x8b"
_ZSTD = b"\x28\xb5\x2f\xfd"
_COMPRESSED_BYTES = 1 << 12  # read at a time; some ten times as much comes out, of a hostile zstd 32 000 times

# First bytes of other formats that people have, and their names.
_OTHERS: Final = (
    (b"LOGG", "Vector BLF"),
    (b"MDF     ", "ASAM MDF"),
    (b"date ", "Vector ASC"),
    (b";$FILEVERSION", "PEAK TRC"),
    (b"timestamp,", "CSV"),
    (b"SQLite format 3", "an SQLite database"),
    (b"\x0a\x0d\x0d\x0a", "pcapng"),
    (b"\xd4\xc3\xb2\xa1", "pcap"),
    (b"\xa1\xb2\xc3\xd4", "pcap"),
    (b"\x4d\x3c\xb2\xa1", "pcap"),
    (b"\x89MCAP0\r\n", "MCAP"),
    (b"\xfd7zXZ", "compressed with xz"),
    (b"BZh", "compressed with bzip2"),
    (b"PK\x03\x04", "a zip archive"),
)


class _Decompressor(Protocol):
    """The common interface of zlib, compression.zstd and zstandard."""

    @property
    def eof(self) -> bool: ...

    @property
    def unused_data(self) -> bytes: ...

    def decompress(self, data: bytes, /) -> bytes: ...


class LogFile:
    """A log file opened for reading."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Open `path`; raises LogError if it cannot be opened."""
        self.path = os.fspath(path)
        self.cut = False  # the compressed data ended before its end mark
        try:
            self._file = open(self.path, "rb")  # noqa: SIM115 - closed by close()
            self._size = os.fstat(self._file.fileno()).st_size  # 0 of a pipe
            head = self._file.peek(len(_ZSTD))
        except OSError as error:
            raise LogError(
                f"{self.path}: expected a candump log, found none that can be read ({error.strerror}); "
                "check the path and its permissions"
            ) from error
        self._new: Callable[[], _Decompressor] | None = None
        self._damage: type[Exception] = zlib.error
        if head.startswith(_GZIP):
            self._new = lambda: zlib.decompressobj(wbits=31)
        elif head.startswith(_ZSTD):
            try:
                self._new, self._damage = _zstd(self.path)
            except LogError:
                self._file.close()
                raise
        self._decompressor: _Decompressor | None = None
        self._text = memoryview(b"")  # decompressed and not yet handed over

    def fraction_read(self) -> float:
        """Return the fraction of the file that has been read, above 0; 1 if the file has no size."""
        return max(1, self._file.tell()) / self._size if self._size else 1.0

    def readinto(self, target: memoryview) -> int:
        """Read the next bytes of text into `target`; return their number, 0 at the end. LogError if damaged."""
        if self._new is None:
            return self._file.readinto(target)
        while not self._text:
            try:
                text = self._decompress(self._new)
            except self._damage as error:
                raise LogError(
                    f"{self.path}: expected whole compressed data, found it damaged ({error}); "
                    "copy the file again from where it was recorded"
                ) from error
            if text is None:
                return 0
            self._text = memoryview(text)
        size = min(len(target), len(self._text))
        target[:size] = self._text[:size]
        self._text = self._text[size:]
        return size

    def _decompress(self, new: Callable[[], _Decompressor]) -> bytes | None:
        """Return the text of the next compressed bytes, which may be empty; None at the end."""
        before = self._decompressor
        if before is None or before.eof:
            # Files that were joined or appended to hold several streams, and zeros may pad the end.
            rest = (before.unused_data if before else b"") or self._file.read(_COMPRESSED_BYTES)
            rest = rest.lstrip(b"\0")
            if not rest:
                self._decompressor = None
                return None
            self._decompressor = new()
            return self._decompressor.decompress(rest)
        compressed = self._file.read(_COMPRESSED_BYTES)
        if not compressed:
            self.cut = True
            self._decompressor = None
            return None
        return before.decompress(compressed)

    def close(self) -> None:
        """Close the file; idempotent."""
        self._file.close()


def other_format(head: bytes) -> str | None:
    """Return the likely format of a file that is not candump text, by its first bytes."""
    for magic, name in _OTHERS:
        if head.startswith(magic):
            return name
    return "binary data" if b"\0" in head else None


def _zstd(path: str) -> tuple[Callable[[], _Decompressor], type[Exception]]:
    """Return a decompressor for zstd and its error class, from the module that is installed."""
    for module in ("compression.zstd", "backports.zstd"):
        try:
            zstd: Any = importlib.import_module(module)
        except ImportError:
            continue
        return zstd.ZstdDecompressor, zstd.ZstdError
    try:
        zstd = importlib.import_module("zstandard")
    except ImportError:
        raise LogError(
            f"{path}: expected plain text or gzip, found zstd, which this Python cannot read; "
            "run 'pip install zstandard', or unpack the file with 'zstd -d'"
        ) from None
    return lambda: cast(_Decompressor, zstd.ZstdDecompressor().decompressobj()), zstd.ZstdError
