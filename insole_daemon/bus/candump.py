"""Read candump logs (`candump -L` and `-l`) as batches of frames: plain text, .gz, .zst."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from ..errors import LogError
from .candump_fast import PAD
from .candump_file import LogFile, other_format
from .candump_line import BadLine, dropped_frames, parse_line, shown_line
from .candump_piece import Piece, PieceDecoder, RefusedLine
from .frames import ERROR, FD, REMOTE, FrameBatch
from .growing import GrowingBatch

CHUNK_FRAMES: Final = 1 << 16  # frames of a batch, more or less

_PIECE_BYTES = 1 << 19  # decoded at a time: small enough for its columns to stay in the cache of one core
_RECENT_FRAMES = 1000  # remembered to judge the last line by
_LATEST_NS = 9_223_372_036_000_000_000  # nearly what int64 holds
# Steps backwards of a clock that is set, in all. Those of lines in no order would make hours of a log of seconds.
_MOST_REMOVED_NS, _MOST_REMOVED_SPANS = 60_000_000_000, 3
_EXAMPLE = "(1741532714.334381) can0 470#40EEEFF1EFF1F1F0"
_SCREEN_OUTPUT = re.compile(rb"\s*(\(.*\))?\s*\S+\s+[0-9A-F]{3,8}\s+\[\d+\]")


@dataclass(frozen=True, slots=True)
class LogCounters:
    """Numbers of frames in a log, and of those missing from it."""

    frames: int = 0  # all of them; the next three kinds are among them
    error_frames: int = 0
    remote_frames: int = 0
    fd_frames: int = 0  # of a longer payload only the first 8 bytes are kept
    clock_steps: int = 0  # times that time goes backwards from one frame to the next
    dropped: int = 0  # frames that the kernel dropped, by the notes of `candump -d`
    torn: int = 0  # 1 if the end is lost: half a line, or compressed data without their end


@dataclass(frozen=True, slots=True)
class CandumpLog:
    """A whole log. `t_ns` is the log's time, `t_mono_ns` the same with every step backwards removed."""

    frames: FrameBatch
    interfaces: tuple[str, ...]  # in the order in which they appear; FrameBatch.interface counts in them
    counters: LogCounters
    warnings: tuple[str, ...]  # one sentence per defect


def read(path: str | os.PathLike[str]) -> CandumpLog:
    """Read the log at `path`; raises LogError if it is not a log."""
    frames = GrowingBatch()
    with CandumpReader(path) as reader:
        for piece in reader.pieces():
            frames.append(piece, reader.expected_frames())
        return CandumpLog(frames.batch(), reader.interfaces, reader.counters, reader.warnings)


class CandumpReader:
    """Reads a log in batches of about CHUNK_FRAMES, so that it may be larger than memory.

        with CandumpReader("can.log") as reader:
            for batch in reader: ...

    `interfaces`, `counters` and `warnings` grow during the reading; every step may raise LogError.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Open `path`; raises LogError if it cannot be opened."""
        self.counters = LogCounters()
        self.warnings: tuple[str, ...] = ()
        self._file = LogFile(path)
        self._path = self._file.path
        self._decoder = PieceDecoder()
        self._head = b""  # the first bytes of the text
        self._lines = 0  # before the piece at hand
        self._last_ns: int | None = None  # time of the frame before
        self._removed_ns = 0  # sum of the steps backwards so far
        self._earliest_ns, self._latest_ns = _LATEST_NS, 0  # of the frames so far
        self._recent = FrameBatch.empty()

    @property
    def interfaces(self) -> tuple[str, ...]:
        """The names of interfaces read so far, in order of appearance."""
        return tuple(self._decoder.names)

    def expected_frames(self) -> int:
        """Return an estimate of the number of frames in the log, from the part of the file read so far."""
        return int(self.counters.frames / self.fraction_read)

    @property
    def fraction_read(self) -> float:
        """Return the fraction of the file that has been read, above 0."""
        return self._file.fraction_read()

    def __enter__(self) -> Self:
        """Return the reader."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file."""
        self.close()

    def close(self) -> None:
        """Close the file; idempotent."""
        self._file.close()

    def __iter__(self) -> Iterator[FrameBatch]:
        """Yield the frames in order, in batches of about CHUNK_FRAMES."""
        pieces: list[FrameBatch] = []
        for piece in self.pieces():
            pieces.append(piece)
            if sum(map(len, pieces)) >= CHUNK_FRAMES:
                yield FrameBatch.concatenate(pieces)
                pieces = []
        if pieces:
            yield FrameBatch.concatenate(pieces)

    def pieces(self) -> Iterator[FrameBatch]:
        """Yield the frames in order, in non-empty batches as they are decoded, some ten thousand frames each."""
        buffer = bytearray(PAD + _PIECE_BYTES + PAD)
        room = memoryview(buffer)[PAD : PAD + _PIECE_BYTES]
        held = 0
        while size := self._file.readinto(room[held:]):
            held += size
            self._head = self._head or bytes(room[: min(held, 16)])
            whole = buffer.rfind(b"\n", PAD, PAD + held) + 1 - PAD
            if whole > 0:
                rest = bytes(room[whole:held])
                yield from self._piece(buffer, whole)
                held = len(rest)
                room[:held] = rest
            elif held == _PIECE_BYTES:
                first = self.counters.frames == 0
                raise self._refusal(RefusedLine(0, bytes(room[:256]), "lines of some 50 characters", first))
        rest = bytes(room[:held]).rstrip(b"\r ")
        if rest and self._is_whole(rest):
            buffer[PAD + len(rest)] = ord("\n")
            yield from self._piece(buffer, len(rest) + 1)
        if self._file.cut:
            self._tear(f"the compressed data stop before their end, after line {self._lines}")
        if self.counters.frames == 0:
            what = "no frame in it" if self._head else "an empty file"
            raise LogError(
                f"{self._path}: expected a candump log, found {what}; "
                "check that the recording was running and that there was traffic on the bus"
            )
        self._warn_of_counters()

    def _piece(self, buffer: bytearray, size: int) -> Iterator[FrameBatch]:
        """Yield the frames of the first `size` bytes, which are whole lines."""
        try:
            piece = self._decoder.decode(buffer, size)
        except RefusedLine as refused:
            raise self._refusal(refused) from None
        frames = piece.frames
        if len(frames):
            frames = replace(frames, t_mono_ns=self._monotonic(piece))
            self._recent = (frames if len(frames) > _RECENT_FRAMES else FrameBatch.concatenate([self._recent, frames]))[
                -_RECENT_FRAMES:
            ]
            self._count(frames.flags)
            yield frames
        self._lines += piece.lines

    def _count(self, flags: NDArray[np.uint8]) -> None:
        counters = self.counters
        self.counters = replace(
            counters,
            frames=counters.frames + len(flags),
            error_frames=counters.error_frames + int(np.count_nonzero(flags & ERROR)),
            remote_frames=counters.remote_frames + int(np.count_nonzero(flags & REMOTE)),
            fd_frames=counters.fd_frames + int(np.count_nonzero(flags & FD)),
        )

    def _monotonic(self, piece: Piece) -> NDArray[np.int64]:
        """Return the times of the frames in ns with steps backwards removed."""
        t_ns = piece.frames.t_ns
        step_ns = np.diff(t_ns, prepend=t_ns[0] if self._last_ns is None else self._last_ns)
        self._last_ns = int(t_ns[-1])
        self._earliest_ns = min(self._earliest_ns, int(t_ns.min()))
        self._latest_ns = max(self._latest_ns, int(t_ns.max()))
        backwards = np.flatnonzero(step_ns < 0)
        if not len(backwards) and self._last_ns + self._removed_ns < _LATEST_NS:
            return t_ns + self._removed_ns
        steps_ns = np.where(step_ns < 0, -step_ns, 0)
        # Added up they may be more than 64 bits hold, which floating point shows.
        too_late = float(self._removed_ns) + np.cumsum(steps_ns, dtype=np.float64) + t_ns >= _LATEST_NS
        if too_late.any():
            raise LogError(
                f"{self._path}: line {self._lines + 1 + piece.line_of(int(too_late.argmax()))}: expected times that "
                "go on, found them go back and forth over more than 292 years; take out the lines with a wrong time"
            )
        if not self.counters.clock_steps:
            first = int(backwards[0])
            self._warn(
                f"line {self._lines + 1 + piece.line_of(first)}: time goes back by {-step_ns[first] / 1e9:.6f} s, "
                "which is taken out"
            )
        self.counters = replace(self.counters, clock_steps=self.counters.clock_steps + len(backwards))
        removed_ns: NDArray[np.int64] = self._removed_ns + np.cumsum(steps_ns)
        self._removed_ns = int(removed_ns[-1])
        span_ns = self._latest_ns - self._earliest_ns
        if self._removed_ns > _MOST_REMOVED_NS + _MOST_REMOVED_SPANS * span_ns:
            raise LogError(
                f"{self._path}: expected frames in the order of their times, found that time goes back "
                f"{self.counters.clock_steps} times by {self._removed_ns / 1e9:.0f} s in all, in a log of "
                f"{span_ns / 1e9:.0f} s; sort its lines by their times and try again"
            )
        return t_ns + removed_ns

    def _is_whole(self, rest: bytes) -> bool:
        """Return whether the text after the last newline is a complete line without newline; warn if it is not."""
        if dropped_frames(rest) is not None:
            return True
        try:
            frame = parse_line(rest)
        except BadLine as bad:
            if not self.counters.frames:
                raise self._refusal(RefusedLine(0, rest, str(bad), True)) from None
            self._tear(f"line {self._lines + 1} is torn, found {shown_line(rest)}")
            return False
        # Half a payload is a valid payload, so its length is compared with earlier frames of the same identifier.
        recent = self._recent
        alike = recent.dlc[(recent.can_id == frame.can_id) & (recent.flags == frame.flags)]
        if len(alike) and frame.dlc < alike[-1]:
            self._tear(
                f"line {self._lines + 1} is torn, found {shown_line(rest)} "
                f"where the same identifier had {alike[-1]} bytes before"
            )
            return False
        return True

    def _tear(self, what: str) -> None:
        self.counters = replace(self.counters, torn=1)
        self._warn(f"{what}; the {self.counters.frames} frames before it are kept")

    def _warn(self, message: str) -> None:
        self.warnings += (f"{self._path}: {message}",)

    def _warn_of_counters(self) -> None:
        """Add the warnings that depend on the whole log."""
        self.counters = replace(self.counters, dropped=self._decoder.dropped)
        if self.counters.dropped:
            self._warn(f"candump noted that the kernel dropped {self.counters.dropped} frames")
        if self.counters.clock_steps > 1:
            self._warn(f"time goes back {self.counters.clock_steps} times")
        if self.counters.fd_frames:
            self._warn(f"{self.counters.fd_frames} frames are CAN FD, which the insole does not send")

    def _refusal(self, refused: RefusedLine) -> LogError:
        """Return the error for a wrong line, or for a file that is not a candump log at all."""
        number, line = self._lines + refused.index + 1, refused.line
        if not refused.first or self.counters.frames or re.match(rb"\(\d+\.\d+\) \S+ +\S+#", line):
            return LogError(
                f"{self._path}: line {number}: expected {refused.expected}, found {shown_line(line)}; "
                "take the line out, or record with 'candump -L' or 'candump -l'"
            )
        if _SCREEN_OUTPUT.match(line):
            return LogError(
                f"{self._path}: line {number}: expected candump's log format ({_EXAMPLE}), "
                f"found its screen format, {shown_line(line)}; record with 'candump -L' or 'candump -l'"
            )
        other = other_format(self._head) or ("binary data" if b"\0" in line else shown_line(line))
        return LogError(
            f"{self._path}: line {number}: this is not candump text: expected lines such as "
            f"{_EXAMPLE}, found {other}; 'can_logconvert' of python-can converts BLF, ASC, TRC, MDF and CSV"
            ": can_logconvert IN OUT.log; a compressed file must be plain, .gz or .zst"
        )
