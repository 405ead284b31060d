"""Decode a piece of a log, whole lines of it: most lines in bulk, the others line by line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .candump_fast import PAD, Columns, TimeForm, decode
from .candump_line import BadLine, Line, dropped_frames, interface_name, parse_line
from .frames import FrameBatch

INTERFACES_MAX: Final = 255


class RefusedLine(Exception):  # noqa: N818 - it becomes a LogError once the path is known
    """The error for a line that candump would not write."""

    def __init__(self, index: int, line: bytes, expected: str, first: bool) -> None:
        """`index`: number of the line, from 0; `expected`: text for the message; `first`: no frame precedes it."""
        super().__init__(expected)
        self.index, self.line, self.expected, self.first = index, line, expected, first


@dataclass(frozen=True, slots=True)
class Piece:
    """The frames of a piece, with `t_mono_ns` still the log's own time, and their line numbers."""

    frames: FrameBatch
    lines: int  # in the piece, those without a frame too
    line: NDArray[np.intp] | None  # (n,) line of each frame, from 0; None if each line is a frame

    def line_of(self, row: int) -> int:
        """Return the line of frame `row`, both counted from 0."""
        return row if self.line is None else int(self.line[row])


@dataclass(slots=True)
class _NewKey:
    """A spelling of a name, with its spaces, that is new in a piece."""

    first: int  # line
    name: str
    characters: NDArray[np.uint64]
    lines: NDArray[np.bool_]


class PieceDecoder:
    """Decodes the pieces of one log in order, and remembers the interfaces."""

    def __init__(self) -> None:
        """For a new log."""
        self.names: dict[str, int] = {}  # index of each name, in the order of appearance
        self.dropped = 0  # frames, by the notes of `candump -d`
        self._keys: list[tuple[NDArray[np.uint64], int]] = []  # a name as it stands in lines, its index
        self._form = TimeForm(seconds=10, decimals=6)  # what candump writes

    def decode(self, buffer: bytearray, size: int) -> Piece:
        """Decode `size` bytes of `buffer`, whole lines that start PAD bytes after its start and end PAD before its end.

        Raises RefusedLine for the first bad line. CR LF becomes LF in place.
        """
        end = PAD + size
        if buffer.find(b"\r", PAD, end) >= 0:
            text = buffer[PAD:end].replace(b"\r\n", b"\n")
            end = PAD + len(text)
            buffer[PAD:end] = text
        # A log that starts at zero gets one more digit at 10 s, 100 s, ...: few pieces see that happen.
        middle = buffer.find(b"\n", PAD + (end - PAD) // 2, end - 1) + 1 or PAD
        self._form = TimeForm.of(bytes(buffer[middle : middle + PAD])) or self._form
        columns = decode(np.frombuffer(buffer, np.uint8), PAD, end, self._form)
        interface, new = self._find_names(columns)
        n = len(columns.ok)
        if columns.ok.all():
            self._learn(new, [], interface)
            return Piece(_batch(columns, interface), n, None)
        careful = self._read_carefully(buffer, columns)
        self._learn(new, careful, interface)
        keep = columns.ok
        for index, line in careful:
            keep[index] = True
            columns.t_ns[index], interface[index] = line.t_ns, self.names[line.name]
            columns.can_id[index], columns.flags[index] = line.can_id, line.flags
            columns.dlc[index], columns.data[index] = line.dlc, tuple(line.data)
        frames = _batch(columns, interface)
        if keep.all():
            return Piece(frames, n, None)
        kept = np.flatnonzero(keep)
        return Piece(frames[kept], n, kept)

    def _find_names(self, columns: Columns) -> tuple[NDArray[np.uint8], list[_NewKey]]:
        """Return the interface of each line (n,), 0 if its name is new, and the new names.

        A line without a name is marked as not ok.
        """
        interface = np.zeros(len(columns.ok), np.uint8)
        known = ~columns.ok
        for characters, index in self._keys:
            lines = _equal(columns.key, characters)
            known |= lines
            interface |= lines * np.uint8(index)  # at most one key is equal
        new: list[_NewKey] = []
        unknown = ~known
        while unknown.any():
            first = int(unknown.argmax())
            characters = columns.key[:, first].copy()
            lines = _equal(columns.key, characters) & unknown
            unknown &= ~lines
            raw = characters.tobytes().rstrip(b"\0")
            name = interface_name(raw.strip(b" ")) if raw.startswith(b" ") else None
            if name is None:
                columns.ok[lines] = False
            else:
                new.append(_NewKey(first, name, characters, lines))
        return interface, new

    def _read_carefully(self, buffer: bytearray, columns: Columns) -> list[tuple[int, Line]]:
        """Return the frames of the lines that are not ok, each with its line number."""
        frames: list[tuple[int, Line]] = []
        for index in np.flatnonzero(~columns.ok).tolist():
            line = bytes(buffer[columns.first[index] : columns.newline[index]])
            dropped = dropped_frames(line)
            if dropped is not None:
                self.dropped += dropped
            elif line.strip():
                try:
                    frames.append((index, parse_line(line)))
                except BadLine as bad:
                    first = not frames and not columns.ok[:index].any()
                    raise RefusedLine(index, line, str(bad), first) from None
        return frames

    def _learn(self, new: list[_NewKey], careful: list[tuple[int, Line]], interface: NDArray[np.uint8]) -> None:
        """Give each new name an index, in the order of appearance in the log."""
        appearances = [(key.first, key.name) for key in new]
        appearances += [(index, line.name) for index, line in careful if line.name not in self.names]
        for index, name in sorted(appearances):
            if self.names.setdefault(name, len(self.names)) >= INTERFACES_MAX:
                raise RefusedLine(index, name.encode(), f"at most {INTERFACES_MAX} interfaces", False)
        for key in new:
            interface[key.lines] = self.names[key.name]
            self._keys.append((key.characters, self.names[key.name]))


def _equal(key: NDArray[np.uint64], characters: NDArray[np.uint64]) -> NDArray[np.bool_]:
    """Return whether the key of each line is `characters`, (n,)."""
    equal: NDArray[np.bool_] = key[0] == characters[0]
    for word in range(1, len(key)):
        equal &= key[word] == characters[word]
    return equal


def _batch(columns: Columns, interface: NDArray[np.uint8]) -> FrameBatch:
    return FrameBatch(columns.t_ns, columns.t_ns, interface, columns.can_id, columns.dlc, columns.data, columns.flags)
