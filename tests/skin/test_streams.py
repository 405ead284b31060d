"""Which frame is which half of which triangle, and what becomes of all others."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest

from insole_daemon.bus.frames import ERROR, EXTENDED, FD, REMOTE, FrameBatch
from insole_daemon.skin import streams as module
from insole_daemon.skin.layout import builtin
from insole_daemon.skin.streams import Streams

from ..implementations import numpy_and_compiled

implementation = numpy_and_compiled(module)

LEFT, RIGHT = builtin("left", (5, 6, 7)), builtin("right", (8, 9, 10))
TRIANGLES = [(t.board, t.triangle) for layout in (LEFT, RIGHT) for t in layout.triangles]
PLACE = {identity: place for place, identity in enumerate(TRIANGLES)}
NOTHING = asdict(Streams([LEFT]).refused)


def frames(*rows: tuple[int, bytes] | tuple[int, bytes, int]) -> FrameBatch:
    """Rows of (identifier, payload, flags)."""
    n = len(rows)
    t_ns = np.arange(n, dtype=np.int64)
    data = np.array([list(row[1][:8].ljust(8, b"\0")) for row in rows], np.uint8).reshape(n, 8)
    return FrameBatch(
        t_ns, t_ns, np.zeros(n, np.uint8), np.array([row[0] for row in rows], np.uint32),
        np.array([len(row[1]) for row in rows], np.uint8), data,
        np.array([row[2] if len(row) > 2 else 0 for row in rows], np.uint8),
    )  # fmt: skip


def half(tag: int) -> bytes:
    return bytes([tag, 1, 2, 3, 4, 5, 6, 7])


def refused(streams: Streams) -> dict:
    """What has been refused, without the reasons that did not occur."""
    return {reason: count for reason, count in asdict(streams.refused).items() if count}


@pytest.mark.parametrize("tag", [0x40, 0xC0, 0x00, 0x41, 0x80, 0xFF])
def test_every_identifier(tag: int) -> None:
    streams = Streams([LEFT, RIGHT])
    slots = streams.slots(frames(*((can_id, half(tag)) for can_id in range(2048))))
    expected = {}
    for (board, triangle), place in PLACE.items():
        source = board << 4 | triangle
        if tag == 0x40:
            expected |= {0x300 | source: 2 * place, 0x400 | source: 2 * place}
        if tag == 0xC0:
            expected |= {cls << 8 | source: 2 * place + 1 for cls in (3, 4, 6)}
    assert {can_id: slot for can_id, slot in enumerate(slots.tolist()) if slot >= 0} == expected
    boards = {board for board, _ in TRIANGLES}
    counted = asdict(streams.refused)
    assert counted.pop("unconfigured_board") == {address: 16 for address in range(16) if address not in boards}
    known = 16 * len(boards)
    assert counted.pop("unknown_tag") == (0 if tag in (0x40, 0xC0) else known)
    assert counted.pop("unconfigured_triangle") == (known - len(TRIANGLES) if tag in (0x40, 0xC0) else 0)
    in_class_4 = sum(can_id >> 8 == 4 for can_id in expected)
    assert counted.pop("other") == 2048 - 256 - (len(expected) - in_class_4)
    assert not any(counted.values())


def test_one_foot_alone_takes_no_halves_of_the_other() -> None:
    streams = Streams([RIGHT])
    slots = streams.slots(frames((0x480, half(0x40)), (0x450, half(0x40)), (0x48F, half(0xC0))))
    assert slots[0] == 0
    assert slots[1] < 0
    assert slots[2] == 2 * RIGHT.rows[8, 15] + 1
    assert refused(streams) == {"unconfigured_board": {5: 1}}


def test_legacy_class_3_carries_both_halves() -> None:
    streams = Streams([LEFT])
    assert streams.slots(frames((0x351, half(0x40)), (0x351, half(0xC0)))).tolist() == [2, 3]
    assert refused(streams) == {}


def test_class_6_carries_the_second_half_alone() -> None:
    streams = Streams([LEFT])
    slots = streams.slots(frames((0x651, half(0xC0)), (0x651, half(0x40)), (0x652, half(0xC0)), (0x651, b"\xc0")))
    assert slots[0] == 3
    assert (slots[1:] < 0).all()
    assert refused(streams) == {"other": 3}


@pytest.mark.parametrize(
    ("can_id", "payload"),
    [
        (0x35E, bytes.fromhex("0112001200")),  # the thermometer of board 5, whose triangle 14 is configured
        (0x35E, bytes.fromhex("0112001200000000")),
        (0x3D1, bytes.fromhex("40BBCCDDEEFF")),  # force and torque
        (0x350, half(0x40)[:7]),  # a legacy half that is cut
        (0x352, half(0x40)),  # a triangle that board 5 has not
        (0x3D1, half(0x40)),
        (0x553, half(0xC0)),  # an IMU
        (0x205, bytes.fromhex("4D0014F0")),
        (0x250, bytes.fromhex("1C0B010203020001")),
        (0x7A0, bytes.fromhex("FF0B010203")),
        (0x755, b"\0"),  # as an overflow, but with a payload
        (0x756, b""),
        (0x100, half(0xC0)),
        (0x000, b""),
    ],
)
def test_other_traffic(can_id: int, payload: bytes) -> None:
    streams = Streams([LEFT])
    assert streams.slots(frames((can_id, payload))).tolist() == [-1]
    assert refused(streams) == {"other": 1}


@pytest.mark.parametrize(
    ("flags", "reason"),
    [
        (REMOTE, "remote"),
        (EXTENDED, "extended"),
        (FD, "fd"),
        (ERROR, "error"),
        (REMOTE | EXTENDED, "remote"),
        (FD | EXTENDED, "fd"),
        (ERROR | EXTENDED, "error"),
    ],
)
@pytest.mark.parametrize("can_id", [0x450, 0x4C3, 0x755, 0x123])
def test_frames_of_another_kind(flags: int, reason: str, can_id: int) -> None:
    streams = Streams([LEFT])
    assert streams.slots(frames((can_id, half(0x40), flags), (can_id, b"", flags)))[0] < 0
    assert refused(streams) == {reason: 2}


def test_a_29_bit_identifier_is_never_a_half() -> None:
    streams = Streams([LEFT])
    assert streams.slots(frames((0x1234_5450, half(0x40), EXTENDED)))[0] < 0
    assert refused(streams) == {"extended": 1}


@pytest.mark.parametrize("can_id", [0x450, 0x452, 0x4C3])
def test_a_skin_frame_has_8_bytes(can_id: int) -> None:
    streams = Streams([LEFT])
    slots = streams.slots(frames(*((can_id, half(0x40)[:n]) for n in range(8))))
    assert (slots < 0).all()
    assert refused(streams) == {"bad_dlc": 8}


def test_an_mtb3_reports_that_its_queue_overflowed() -> None:
    streams = Streams([LEFT])
    streams.slots(frames((0x755, b""), (0x755, b""), (0x7C5, b"")))
    assert refused(streams) == {"overflow": {5: 2, 12: 1}}


def test_counters_add_up_and_halves_between_are_kept() -> None:
    streams = Streams([LEFT])
    rows = [
        (0x450, half(0x40)), (0x450, half(0x99)), (0x452, half(0x40)), (0x4C0, half(0x40)),
        (0x450, b""), (0x450, half(0xC0)), (0x123, b"abc"), (0x450, b"", REMOTE),
        (0x450, half(0x40), EXTENDED), (0x450, half(0x40), FD), (0x004, bytes(8), ERROR),
    ]  # fmt: skip
    for _ in range(3):
        slots = streams.slots(frames(*rows))
        assert np.flatnonzero(slots >= 0).tolist() == [0, 5]
        assert slots[[0, 5]].tolist() == [0, 1]
    assert refused(streams) == {
        "unknown_tag": 3, "unconfigured_triangle": 3, "unconfigured_board": {12: 3}, "bad_dlc": 3, "other": 3,
        "remote": 3, "extended": 3, "fd": 3, "error": 3,
    }  # fmt: skip


def test_no_frames_give_no_slots() -> None:
    streams = Streams([LEFT])
    assert streams.slots(frames()).tolist() == []
    assert asdict(streams.refused) == NOTHING
