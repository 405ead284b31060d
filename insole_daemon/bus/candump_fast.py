"""Decode many candump lines at once: a piece of text into columns, with some hundred array operations.

There is no loop over lines. Newlines and `#` are found first; around them each line is cut into words of
eight characters, and a word is one uint64 in which eight digits are checked and converted together ("SIMD
within a register": L. Lamport, Multiple byte processing with full-word instructions, CACM 18(8), 1975).

A line is decoded only if every byte is one that candump would have written. All others (CAN FD, remote frames, blank
lines, a time in another form, garbage) are left to `candump_line`, which reads or explains them. The machine must be
little-endian, as for reading SocketCAN.
"""

from __future__ import annotations

import binascii
from dataclasses import dataclass
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from .candump_line import SECONDS_MAX
from .frames import ERROR, EXTENDED

PAD: Final = 64  # bytes around a piece that must exist in its array; what they hold has no influence
KEY_WORDS: Final = 3  # a name and the spaces on both of its sides; longer ones are read line by line

_U64 = np.uint64
_ZEROS = _U64(0x3030_3030_3030_3030)  # "00000000"
_HIGH_BITS = _U64(0x8080_8080_8080_8080)
_NANOSECONDS = np.int64(1_000_000_000)


class _WordForm(NamedTuple):
    """The expected form of eight characters: after `^ pattern & care`, digits are 0..9 and the rest is 0."""

    pattern: np.uint64
    care: np.uint64  # 0xFF at the characters that are checked
    limit: np.uint64  # added to them, sets the high bit of each that is too large


@dataclass(frozen=True, slots=True)
class TimeForm:
    """The form of the times of a log: number of digits of the seconds, and number of decimals."""

    seconds: int  # 1..15
    decimals: int  # 1..9

    @classmethod
    def of(cls, line: bytes) -> Self | None:
        """Return the form of the time at the start of `line`; None if it cannot be decoded in bulk."""
        point, close = line.find(b".", 0, 17), line.find(b")", 0, 27)
        seconds, decimals = point - 1, close - point - 1
        return cls(seconds, decimals) if 1 <= seconds <= 15 and 1 <= decimals <= 9 else None

    def words(self) -> list[_WordForm | None]:
        """Return the form of 32 characters with the point as the 17th, as words; None for a word without digits."""
        time = b"(" + b"0" * self.seconds + b"." + b"0" * self.decimals + b")"
        window = (bytes(15 - self.seconds) + time).ljust(32, b"\0")
        characters = np.frombuffer(window, np.uint8)
        care = np.where(characters == 0, 0, 0xFF).astype(np.uint8).view(_U64)
        limit = np.where(characters == ord("0"), 0x76, care.view(np.uint8) & 0x7F).astype(np.uint8).view(_U64)
        forms = zip(characters.view(_U64), care, limit, strict=True)
        return [_WordForm(*form) if form[1] else None for form in forms]


@dataclass(frozen=True, slots=True)
class Columns:
    """The n lines of a piece, including blank ones; the other columns are defined only where `ok` is true."""

    ok: NDArray[np.bool_]  # (n,) the line was read
    first: NDArray[np.intp]  # (n,) where the line begins in the text
    newline: NDArray[np.intp]  # (n,) where its newline is
    t_ns: NDArray[np.int64]  # (n,)
    key: NDArray[np.uint64]  # (KEY_WORDS, n) the characters between time and identifier, 0 beyond them
    can_id: NDArray[np.uint32]  # (n,)
    dlc: NDArray[np.uint8]  # (n,)
    data: NDArray[np.uint8]  # (n, 8)
    flags: NDArray[np.uint8]  # (n,)


def _low_bytes(n: NDArray[np.intp], word: int) -> NDArray[np.uint64]:
    """Return masks of the bytes of word number `word` that belong to the first `n` bytes."""
    kept = np.clip(n - 8 * word, 0, 8)
    return np.array([(1 << 8 * int(k)) - 1 for k in kept], _U64)


_DATA_MASKS = [_low_bytes(np.arange(17), word) for word in range(2)]
_KEY_MASKS = [_low_bytes(np.arange(8 * KEY_WORDS + 1), word) for word in range(KEY_WORDS)]


def _positions(text: NDArray[np.uint8], begin: int, end: int, byte: int) -> NDArray[np.intp]:
    """Return the positions of `byte` in text[begin:end], ascending."""
    size = end - begin
    mask = text[begin : begin + size + -size % 8] == byte
    mask[size:] = False
    # Of eight bytes at most one is set as a rule, so numpy need only look for the words that are not zero.
    words = mask.view(_U64)
    at = np.flatnonzero(words != 0)
    hits = words[at]
    if np.any(hits & (hits - _U64(1))):
        return np.flatnonzero(mask) + begin
    # A word with byte k set is 1 << 8k: the product's highest byte is then k.
    byte_of_word: NDArray[np.intp] = ((hits * _U64(0x0001_0203_0405_0607)) >> _U64(56)).view(np.intp)
    return byte_of_word + (at << 3) + begin


def _hashes(
    text: NDArray[np.uint8], begin: int, end: int, first: NDArray[np.intp], newline: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the position of the `#` of each line, undefined unless it has exactly one, and whether it has."""
    hashes = _positions(text, begin, end, ord("#"))
    if len(hashes) == len(newline):
        single = (hashes > first) & (hashes < newline)
        if single.all():
            return hashes, single
    # Some line has none or several.
    start, stop = np.searchsorted(hashes, first), np.searchsorted(hashes, newline)
    single = stop - start == 1
    return np.where(single, np.append(hashes, begin)[start], first), single


def _windows(text: NDArray[np.uint8], at: NDArray[np.intp], words: int) -> NDArray[np.uint64]:
    """Return (n, words): the 8 · words characters that begin at each of the n positions `at`."""
    every = np.ndarray((len(text) - 8 * words,), f"V{8 * words}", text, strides=(1,))
    return every[at].view(_U64).reshape(len(at), words)


def _number(digits: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return the numbers of eight digits each, as bytes 0..9 with the most significant digit in the lowest byte."""
    pairs = (digits * _U64(0x0A01)) >> _U64(8) & _U64(0x00FF_00FF_00FF_00FF)
    fours = (pairs * _U64(0x0064_0001)) >> _U64(16) & _U64(0x0000_FFFF_0000_FFFF)
    return (fours * _U64(0x2710_0000_0001)) >> _U64(32)


def _times(
    text: NDArray[np.uint8], point: NDArray[np.intp], form: TimeForm
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the times in ns with their decimal points at `point`, and which of them have that form."""
    window = _windows(text, point - 16, 4)
    bad = np.zeros(len(point), _U64)
    digits: list[NDArray[np.uint64] | None] = []
    for column, word in enumerate(form.words()):
        if word is None:
            digits.append(None)
            continue
        values = (window[:, column] ^ word.pattern) & word.care
        bad |= (values + word.limit) | values
        digits.append(values)
    high, low, tenths, rest = digits
    # Thousands of lines share a second, so its digits are converted once for each run of equal ones.
    assert low is not None
    assert tenths is not None
    change = low[1:] != low[:-1]
    if high is not None:
        change |= high[1:] != high[:-1]
    runs = np.concatenate(([0], np.flatnonzero(change) + 1))
    seconds = _number(low[runs])
    if high is not None:
        seconds += _number(high[runs]) * _U64(100_000_000)
    too_late = seconds > SECONDS_MAX
    seconds[too_late] = 0
    lengths = np.diff(runs, append=len(point))
    t_ns = np.repeat(seconds.astype(np.int64) * _NANOSECONDS, lengths)
    t_ns += (_number(tenths) * _U64(100)).view(np.int64)
    if rest is not None:
        t_ns += (_number(rest) // _U64(1_000_000)).view(np.int64)
    ok = (bad & _HIGH_BITS) == 0
    if too_late.any():
        ok &= ~np.repeat(too_late, lengths)
    return t_ns, ok


def decode(text: NDArray[np.uint8], begin: int, end: int, form: TimeForm) -> Columns:
    """Decode the lines of text[begin:end], which ends with a newline; `text` has PAD more bytes on either side."""
    newline = _positions(text, begin, end, ord("\n"))
    n = len(newline)
    first = np.empty(n, np.intp)
    first[0] = begin
    np.add(newline[:-1], 1, out=first[1:])
    hash_, ok = _hashes(text, begin, end, first, newline)

    # Payload: an even number of hex digits up to 16, after which ` R` or ` T` may stand.
    marked = text[newline - 2] == ord(" ")
    length = newline - hash_ - 1
    if marked.any():
        length -= marked * 2
        direction = text[newline - 1]
        ok &= ~marked | (direction == ord("R")) | (direction == ord("T"))
    ok &= (length.view(np.uintp) <= 16) & (length & 1 == 0)
    payload = _windows(text, hash_ + 1, 2)
    # `R` is no hex digit either, but it is expected: a remote frame is not to stop the others.
    ok &= (length == 0) | (payload[:, 0] & _U64(0xFF) != ord("R"))

    # Identifier: three digits after a space, or eight.
    identifier = _windows(text, hash_ - 8, 1)[:, 0]
    extended = (identifier >> _U64(32) & _U64(0xFF)) != ord(" ")
    name_end = hash_ - 3 - 5 * extended
    ok &= text[name_end - 1] == ord(" ")

    t_ns, timely = _times(text, first + (1 + form.seconds), form)
    ok &= timely

    name_first = first + (3 + form.seconds + form.decimals)
    name_length = name_end - name_first
    ok &= (name_length >= 3) & (name_length <= 8 * KEY_WORDS)

    if not ok.all():
        length, name_length = np.where(ok, length, 0), np.where(ok, name_length, 0)
        identifier, extended = np.where(ok, identifier, _ZEROS), extended & ok

    characters = _windows(text, name_first, KEY_WORDS)
    key = np.empty((KEY_WORDS, n), _U64)
    for word, masks in enumerate(_KEY_MASKS):
        np.bitwise_and(characters[:, word], masks.take(name_length), out=key[word])

    # Hex digits, all in one go: n identifiers of 8, then n payloads of 16, "0" where a line has none.
    hexadecimal = np.empty(3 * n, _U64)
    short = (identifier & _U64(0xFFFF_FF00_0000_0000)) | _U64(0x30_3030_3030)
    hexadecimal[:n] = np.where(extended, identifier, short)
    for word in range(2):
        kept = (payload[:, word] ^ _ZEROS) & _DATA_MASKS[word].take(length)
        np.bitwise_xor(kept, _ZEROS, out=hexadecimal[n + word :: 2])
    try:
        binary = binascii.unhexlify(hexadecimal.data)
    except binascii.Error:
        ok[:] = False  # some line is garbage, and reading one line at a time finds it
        binary = bytes(12 * n)
    raw_id = np.frombuffer(binary, ">u4", n).astype(np.uint32)
    data = np.frombuffer(binary, np.uint8, 8 * n, 4 * n).reshape(n, 8).copy()  # to be written to

    # The upper three of 32 bits are flags of SocketCAN, of which candump writes only that of an error frame.
    ok &= raw_id <= np.where(extended, np.uint32(0x3FFF_FFFF), np.uint32(0x7FF))
    error = raw_id >> np.uint32(29) & np.uint32(1) != 0
    flags = extended * np.uint8(EXTENDED)
    if error.any():
        flags[error] = ERROR
    can_id = raw_id & np.uint32(0x1FFF_FFFF)
    return Columns(ok, first, newline, t_ns, key, can_id, (length >> 1).astype(np.uint8), data, flags)
