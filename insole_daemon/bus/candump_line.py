"""Read a single candump line in every form that candump writes, and explain what is wrong with other lines.

    (1741532714.334381) can0 470#40EEEFF1EFF1F1F0     data frame, 11-bit identifier
    (1741532714.334381) can0 00000470#40EE R          29-bit identifier; received, as `candump -x` adds
    (1741532714.334381) can0 470#R4                   remote frame, dlc 4; `R` alone is dlc 0
    (1741532714.334381) can0 20000004#0004000000000000   error frame: identifier with CAN_ERR_FLAG
    (1741532714.334381) can0 470##1AABB               CAN FD, with one digit of flags
    (1741532714.334381) can0 470#40EEEFF1EFF1F1F0_C   data frame whose dlc on the wire was 12 (`candump -8`)

Names are padded with spaces to the longest one, as candump does with several interfaces.
"""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from .frames import ERROR, EXTENDED, FD, REMOTE

SECONDS_MAX: Final = 9_223_372_035  # the last whole second that int64 nanoseconds hold entirely (year 2262)

_TIME = rb"\((?P<seconds>[0-9]{1,20})\.(?P<decimals>[0-9]{1,9})\)"
_NAME = rb" +(?P<name>[^ #]+) +"
_IDENTIFIER = rb"(?P<identifier>[0-9A-Fa-f]{8}|[0-9A-Fa-f]{3})#"
_PAYLOAD = (
    rb"(?:(?P<remote>R(?P<remote_dlc>[0-8])?)"
    rb"|(?P<fd>#[0-9A-Fa-f])(?P<fd_data>(?:[0-9A-Fa-f]{2}){0,64})"
    rb"|(?P<data>(?:[0-9A-Fa-f]{2}){0,8}))"
    rb"(?P<raw_dlc>_[9A-Fa-f])?(?: [RT])? *"
)
_LINE = re.compile(_TIME + _NAME + _IDENTIFIER + _PAYLOAD)
_DROPPED = re.compile(rb"DROPCOUNT: dropped ([0-9]{1,20}) CAN frames? on '.*' socket \(total drops [0-9]+\) *")
_FD_LENGTHS = frozenset((*range(9), 12, 16, 20, 24, 32, 48, 64))
_SHOWN_CHARS = 60

# The parts of a line in order, each with the text for a message if it is missing.
_PARTS: Final = (
    (_TIME, "a time in brackets first, as in (1741532714.334381)"),
    (_NAME, "the name of an interface after the time, as in (1741532714.334381) can0 470#40EE"),
    (_IDENTIFIER, "an identifier of 3 or 8 hexadecimal digits and #, as in can0 470#40EE"),
    (_PAYLOAD, "0 to 8 bytes of two hexadecimal digits each after the #, as in 470#40EEEFF1EFF1F1F0"),
)


class BadLine(Exception):  # noqa: N818 - it becomes a LogError once path and line number are known
    """The line is not one that candump writes; the message states what was expected."""


class Line(NamedTuple):
    """The frame of a line, as in FrameBatch, with the name of its interface."""

    t_ns: int
    name: str
    can_id: int
    dlc: int
    data: bytes  # 8 bytes, 0 beyond dlc
    flags: int


def interface_name(raw: bytes) -> str | None:
    """Decode the name of an interface; None if it is empty or not printable text."""
    try:
        name = raw.decode()
    except UnicodeDecodeError:
        return None
    return name if name.isprintable() and name and " " not in name and "#" not in name else None


def dropped_frames(line: bytes) -> int | None:
    """Return the number of dropped frames in a note of `candump -d`; None if `line` is not such a note."""
    note = _DROPPED.fullmatch(line)
    return int(note[1]) if note else None


def parse_line(line: bytes) -> Line:
    """Read `line`, which has no newline; raises BadLine."""
    match = _LINE.fullmatch(line)
    if match is None:
        raise BadLine(_expected(line))
    name = interface_name(match["name"])
    if name is None:
        raise BadLine(_PARTS[1][1])
    seconds = int(match["seconds"])
    if seconds > SECONDS_MAX:
        raise BadLine("a time in seconds before the year 2262 (are these milliseconds or microseconds?)")
    can_id, flags = _identifier(match["identifier"])
    if match["fd"]:
        flags |= FD
        data = bytes.fromhex(match["fd_data"].decode())
        if len(data) not in _FD_LENGTHS:
            raise BadLine(f"0 to 8, 12, 16, 20, 24, 32, 48 or 64 bytes in a CAN FD frame, not {len(data)}")
        dlc = len(data)
    elif match["remote"]:
        flags |= REMOTE
        data, dlc = b"", int(match["remote_dlc"] or 0)
    else:
        data = bytes.fromhex(match["data"].decode())
        dlc = len(data)
    if match["raw_dlc"] and (dlc != 8 or flags & FD):
        raise BadLine(f"a raw dlc ({match['raw_dlc'].decode()}) only after 8 bytes")
    return Line(
        t_ns=seconds * 1_000_000_000 + int(match["decimals"].ljust(9, b"0")),
        name=name,
        can_id=can_id,
        dlc=dlc,
        data=data[:8].ljust(8, b"\0"),
        flags=flags,
    )


def shown_line(line: bytes) -> str:
    """Return `line` for a message: on one line, printable, shortened."""
    text = line.decode(errors="backslashreplace")
    return repr(text) if len(text) <= _SHOWN_CHARS else repr(text[:_SHOWN_CHARS]) + "…"


def _identifier(digits: bytes) -> tuple[int, int]:
    """Return (identifier, flags); in eight digits, bit 29 marks an error frame (linux/can.h)."""
    value = int(digits, 16)
    if len(digits) == 3:
        if value > 0x7FF:
            raise BadLine("an identifier of 3 digits up to 7FF")
        return value, 0
    if value > 0x3FFF_FFFF:
        raise BadLine("an identifier of 8 digits up to 1FFFFFFF, or 20000000 and above for an error frame")
    return (value & 0x1FFF_FFFF, ERROR) if value & 0x2000_0000 else (value, EXTENDED)


def _expected(line: bytes) -> str:
    """Return what is expected in place of the first wrong part of `line`."""
    pattern = b""
    for part, expected in _PARTS:
        pattern += part
        if not re.match(pattern, line):
            return expected
    return _PARTS[-1][1]
