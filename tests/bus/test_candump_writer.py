"""Writing candump logs: candump's own bytes, and what was written read back."""

from __future__ import annotations

import gzip
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insole_daemon.bus import candump_writer
from insole_daemon.bus.candump import read
from insole_daemon.bus.candump_writer import CandumpWriter
from insole_daemon.bus.frames import ERROR, EXTENDED, FD, REMOTE, FrameBatch
from insole_daemon.errors import LogError


def batch(*frames: tuple[int, int, int, int, str, int]) -> FrameBatch:
    """A batch of (t_ns, interface, can_id, dlc, data in hexadecimal, flags)."""
    t_ns, interface, can_id, dlc, data, flags = zip(*frames, strict=True)
    return FrameBatch(
        np.array(t_ns, np.int64),
        np.array(t_ns, np.int64),
        np.array(interface, np.uint8),
        np.array(can_id, np.uint32),
        np.array(dlc, np.uint8),
        np.array([list(bytes.fromhex(d).ljust(8, b"\0")) for d in data], np.uint8),
        np.array(flags, np.uint8),
    )


ONE = batch((1741532714334381999, 0, 0x470, 8, "40EEEFF1EFF1F1F0", 0))


def written(frames: FrameBatch, *interfaces: str) -> str:
    stream = io.BytesIO()
    with CandumpWriter(stream, interfaces) as writer:
        writer.write(frames)
    return stream.getvalue().decode()


@pytest.mark.parametrize(
    ("frame", "text"),
    [
        (
            (1741532714334381999, 0, 0x470, 8, "40EEEFF1EFF1F1F0", 0),
            "(1741532714.334381) can0 470#40EEEFF1EFF1F1F0",
        ),
        ((0, 0, 5, 0, "", 0), "(0000000000.000000) can0 005#"),
        ((12_500_000_000, 0, 0x470, 3, "0A0B0C", EXTENDED), "(0000000012.500000) can0 00000470#0A0B0C"),
        ((0, 0, 4, 8, "0004", ERROR), "(0000000000.000000) can0 20000004#0004000000000000"),
        ((0, 0, 0x123, 0, "", REMOTE), "(0000000000.000000) can0 123#R"),
        ((0, 0, 0x123, 4, "", REMOTE), "(0000000000.000000) can0 123#R4"),
        ((0, 0, 0x123, 8, "", REMOTE | EXTENDED), "(0000000000.000000) can0 00000123#R8"),
        ((9223372036854775807, 0, 0x7FF, 1, "FF", 0), "(9223372036.854775) can0 7FF#FF"),
    ],
)
def test_lines_are_those_of_candump(frame: tuple[int, int, int, int, str, int], text: str) -> None:
    assert written(batch(frame), "can0") == text + "\n"


def test_names_are_padded_as_by_candump() -> None:
    frames = batch((0, 1, 0x123, 0, "", 0), (0, 0, 0x123, 0, "", 0))
    assert written(frames, "can0", "vcan10") == "(0000000000.000000) vcan10 123#\n(0000000000.000000)   can0 123#\n"


def test_an_empty_batch_writes_nothing() -> None:
    assert written(FrameBatch.empty(), "can0") == ""
    assert written(FrameBatch.empty()) == ""


@st.composite
def frame(draw: st.DrawFn) -> tuple[int, int, int, int, str, int]:
    flags = draw(st.sampled_from([0, EXTENDED, ERROR, REMOTE, REMOTE | EXTENDED]))
    can_id = draw(st.integers(0, 0x1FFFFFFF if flags & (EXTENDED | ERROR) else 0x7FF))
    dlc = draw(st.integers(0, 8))
    data = "" if flags & REMOTE else draw(st.binary(min_size=dlc, max_size=dlc)).hex()
    t_us = draw(st.integers(0, 9_223_372_035_999_999))
    return t_us * 1000, draw(st.integers(0, 2)), can_id, dlc, data, flags


@settings(max_examples=200, deadline=None)
@given(frames=st.lists(frame(), min_size=1, max_size=30))
def test_written_values_are_read_back(
    tmp_path_factory: pytest.TempPathFactory, frames: list[tuple[int, int, int, int, str, int]]
) -> None:
    # The steps backwards of random times would add up to more than 64 bits hold.
    expected = batch(*sorted(frames, key=lambda row: row[0]))
    interfaces = ("can0", "vcan10", "insole_left")
    path = tmp_path_factory.mktemp("writer") / "can.log"
    with CandumpWriter(path, interfaces) as writer:
        writer.write(expected[:10])
        writer.write(expected[10:])
    log = read(path)
    assert [log.interfaces[i] for i in log.frames.interface] == [interfaces[i] for i in expected.interface]
    for name in ("t_ns", "t_mono_ns", "can_id", "dlc", "data", "flags"):
        assert np.array_equal(getattr(log.frames, name), getattr(expected, name)), name


def test_many_rows_are_written_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    frames = batch(*((i * 1000, 0, i, i % 9, "", 0) for i in range(100)))
    whole = written(frames, "can0")
    monkeypatch.setattr(candump_writer, "_ROWS_AT_ONCE", 7)
    assert written(frames, "can0") == whole


def test_files(tmp_path: Path) -> None:
    for name, opened in (("can.log", open), ("can.log.gz", gzip.open)):
        with CandumpWriter(tmp_path / name, ["can0"]) as writer:
            writer.write(ONE)
        writer.close()
        with opened(tmp_path / name, "rb") as file:
            assert file.read() == b"(1741532714.334381) can0 470#40EEEFF1EFF1F1F0\n"


def test_frames_that_a_log_cannot_hold_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "can.log"
    cases = [
        (replace(ONE, flags=np.array([FD], np.uint8)), "expected classic CAN frames, found CAN FD"),
        (replace(ONE, interface=np.array([1], np.uint8)), "expected frames of 1 interfaces, found index 1"),
        (replace(ONE, t_ns=np.array([-1])), "expected times from 1970 on and at most 8 bytes, found t_ns -1"),
        (replace(ONE, dlc=np.array([9], np.uint8)), "and dlc 9"),
    ]
    with CandumpWriter(path, ["can0"]) as writer:
        for frames, message in cases:
            with pytest.raises(LogError) as caught:
                writer.write(frames)
            assert str(caught.value).startswith(f"{path}: ")
            assert message in str(caught.value)
    assert path.read_bytes() == b""


@pytest.mark.parametrize("name", ["", "can 0", "can#0", "can\n0"])
def test_a_name_that_would_spoil_the_log_is_refused(name: str) -> None:
    with pytest.raises(LogError, match="expected the name of an interface, as can0, found"):
        CandumpWriter(io.BytesIO(), [name])


def test_a_path_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="check that the folder exists"):
        CandumpWriter(tmp_path / "none" / "can.log", ["can0"])
    with pytest.raises(LogError, match=r"expected a path that ends in \.log or \.log\.gz"):
        CandumpWriter(tmp_path / "can.log.zst", ["can0"])


@pytest.mark.parametrize("names", [["can0"], ["can0", "can1"]])
def test_frames_the_kernel_dropped_are_noted_as_candump_notes_them(tmp_path: Path, names: list[str]) -> None:
    path = tmp_path / "can.log"
    with CandumpWriter(path, names) as writer:
        writer.write(ONE)
        writer.note_dropped(1)
        writer.note_dropped(41)
        writer.write(ONE)
    log = read(path)
    assert (log.counters.frames, log.counters.dropped) == (2, 42)
    assert "(total drops 42)" in path.read_text()
