"""candump logs: what is read, what is refused and in which words, and that both ways of reading agree."""

from __future__ import annotations

import gzip
import itertools
import random
from pathlib import Path

import can
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from insole_daemon.bus import candump, candump_file, candump_line
from insole_daemon.bus.candump import CandumpReader, read
from insole_daemon.bus.candump_fast import PAD, TimeForm, decode
from insole_daemon.bus.frames import ERROR, EXTENDED, FD, REMOTE, FrameBatch
from insole_daemon.errors import LogError

LINE = "(1741532714.334381) can0 470#40EEEFF1EFF1F1F0\n"


def log_file(folder: Path, text: str | bytes, name: str = "can.log") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def refusal(folder: Path, text: str | bytes) -> str:
    with pytest.raises(LogError) as caught:
        read(log_file(folder, text))
    return str(caught.value)


def rows(frames: FrameBatch, interfaces: tuple[str, ...]) -> list[tuple[int, str, int, int, bytes, int]]:
    return [
        (int(t), interfaces[i], int(c), int(n), bytes(d), int(f))
        for t, i, c, n, d, f in zip(
            frames.t_ns, frames.interface, frames.can_id, frames.dlc, frames.data, frames.flags, strict=True
        )
    ]


def ordinary_text(n: int, seed: int = 1) -> str:
    """`n` lines as candump writes them: mixed lengths of names, identifiers and payloads."""
    generator = random.Random(seed)
    t_us = 1_741_532_714_334_381
    lines = []
    for _ in range(n):
        t_us += generator.randrange(400)
        name = generator.choice(["can0", "vcan12", "c", "insole_left"])
        digits = generator.choice([f"{generator.getrandbits(11):03X}"] * 3 + [f"{generator.getrandbits(29):08X}"])
        payload = generator.randbytes(generator.choice([8, 8, 8, *range(9)])).hex().upper()
        lines.append(f"({t_us // 10**6:010d}.{t_us % 10**6:06d}) {name} {digits}#{payload}\n")
    return "".join(lines)


# What is read


def test_a_frame(tmp_path: Path) -> None:
    log = read(log_file(tmp_path, LINE))
    assert rows(log.frames, log.interfaces) == [
        (1741532714334381000, "can0", 0x470, 8, bytes.fromhex("40EEEFF1EFF1F1F0"), 0)
    ]
    assert log.frames.t_mono_ns.tolist() == [1741532714334381000]
    assert log.counters == candump.LogCounters(frames=1)
    assert log.warnings == ()


def test_arrays_have_the_types_of_a_batch_and_can_be_written_to(tmp_path: Path) -> None:
    frames = read(log_file(tmp_path, LINE * 3)).frames
    empty = FrameBatch.empty()
    for name in FrameBatch.__slots__:
        array, expected = getattr(frames, name), getattr(empty, name)
        assert array.dtype == expected.dtype
        assert array.shape[1:] == expected.shape[1:]
        assert array.flags.writeable


@pytest.mark.parametrize("dlc", range(9))
def test_every_dlc(tmp_path: Path, dlc: int) -> None:
    payload = bytes(range(0xA1, 0xA1 + dlc))
    frames = read(log_file(tmp_path, f"(1.000000) can0 123#{payload.hex().upper()}\n")).frames
    assert frames.dlc.tolist() == [dlc]
    assert bytes(frames.data[0]) == payload.ljust(8, b"\0")


@pytest.mark.parametrize(
    ("text", "can_id", "dlc", "data", "flags"),
    [
        ("00000470#40", 0x470, 1, "40", EXTENDED),
        ("1FFFFFFF#", 0x1FFFFFFF, 0, "", EXTENDED),
        ("7ff#abcdef", 0x7FF, 3, "abcdef", 0),
        ("20000004#0004000000000000", 4, 8, "0004", ERROR),
        ("20000088#0000800000000000", 0x88, 8, "000080", ERROR),
        ("123#R", 0x123, 0, "", REMOTE),
        ("123#R4", 0x123, 4, "", REMOTE),
        ("123#R8_9", 0x123, 8, "", REMOTE),
        ("00000123#R", 0x123, 0, "", REMOTE | EXTENDED),
        ("123#0102030405060708_F", 0x123, 8, "0102030405060708", 0),
        ("123##1AABB", 0x123, 2, "AABB", FD),
        ("123##0", 0x123, 0, "", FD),
        ("00000123##3" + "AB" * 64, 0x123, 64, "AB" * 8, FD | EXTENDED),
    ],
)
@pytest.mark.parametrize("direction", ["", " R", " T"])
def test_kinds_of_frames(
    tmp_path: Path, text: str, can_id: int, dlc: int, data: str, flags: int, direction: str
) -> None:
    log = read(log_file(tmp_path, f"(0000000012.500000) can0 {text}{direction}\n"))
    expected = (12_500_000_000, "can0", can_id, dlc, bytes.fromhex(data).ljust(8, b"\0"), flags)
    assert rows(log.frames, log.interfaces) == [expected]
    assert log.counters.error_frames == bool(flags & ERROR)
    assert log.counters.remote_frames == bool(flags & REMOTE)
    assert log.counters.fd_frames == bool(flags & FD)


def test_can_fd_is_warned_of(tmp_path: Path) -> None:
    log = read(log_file(tmp_path, LINE + "(1741532715.0) can0 123##1AABB\n"))
    assert log.warnings == (f"{tmp_path / 'can.log'}: 1 frames are CAN FD, which the insole does not send",)


@pytest.mark.parametrize(
    ("time", "t_ns"),
    [
        ("0000000000.000000", 0),
        ("12.5", 12_500_000_000),
        ("0.000001", 1_000),
        ("1741532714.334381999", 1_741_532_714_334_381_999),
        ("1741532714.3343819", 1_741_532_714_334_381_900),
        ("00001741532714.33", 1_741_532_714_330_000_000),
        ("00000000001741532714.33", 1_741_532_714_330_000_000),
        ("9223372035.999999999", 9_223_372_035_999_999_999),
    ],
)
def test_times_are_exact(tmp_path: Path, time: str, t_ns: int) -> None:
    assert read(log_file(tmp_path, f"({time}) can0 123#\n" * 3)).frames.t_ns.tolist() == [t_ns] * 3


def test_a_log_that_starts_at_zero_is_read_while_its_times_grow(tmp_path: Path) -> None:
    times_us = [0, 9_999_999, 10_000_000, 99_999_999, 100_000_000]
    text = "".join(f"({t / 1e6:f}) can0 123#\n" for t in times_us)
    assert read(log_file(tmp_path, text)).frames.t_ns.tolist() == [t * 1000 for t in times_us]


def test_interfaces_are_numbered_as_they_appear(tmp_path: Path) -> None:
    names = ["vcan1", "can0", "a_name_of_more_than_sixteen_bytes", "PCAN_USBBUS1", "1", "fußsohle"]
    text = "".join(f"(0000000001.000000) {name} 123#\n(2.0) {name} 123#R\n" for name in names)
    log = read(log_file(tmp_path, text))
    assert log.interfaces == tuple(names)
    assert log.frames.interface.tolist() == [i for i in range(len(names)) for _ in range(2)]


def test_names_that_candump_padded(tmp_path: Path) -> None:
    text = "(0000000001.000000)   can0 123#\n(0000000001.000000) vcan10 123#\n(0000000001.000000) can0 123#\n"
    log = read(log_file(tmp_path, text))
    assert log.interfaces == ("can0", "vcan10")
    assert log.frames.interface.tolist() == [0, 1, 0]


def test_crlf_blank_lines_trailing_spaces_and_a_missing_newline(tmp_path: Path) -> None:
    expected = rows((log := read(log_file(tmp_path, LINE * 4))).frames, log.interfaces)
    for text in (
        LINE.replace("\n", "\r\n") * 4,
        "\n\n" + LINE * 2 + "\r\n\n  \n" + LINE * 2 + "\n",
        (LINE * 4)[:-1],
        (LINE * 4)[:-1] + "\r",
        LINE.replace("\n", "  \n") * 4,
        LINE.lower() * 4,
    ):
        log = read(log_file(tmp_path, text))
        assert rows(log.frames, log.interfaces) == expected
        assert log.warnings == ()


def test_a_step_backwards_is_counted_and_taken_out(tmp_path: Path) -> None:
    times = ["100.000000", "101.000000", "99.500000", "99.600000", "99.600000", "50.000000"]
    log = read(log_file(tmp_path, "".join(f"(0000000{t}) can0 123#\n" for t in times)))
    assert (log.frames.t_ns // 10**6).tolist() == [100_000, 101_000, 99_500, 99_600, 99_600, 50_000]
    assert (log.frames.t_mono_ns // 10**6).tolist() == [100_000, 101_000, 101_000, 101_100, 101_100, 101_100]
    assert log.counters.clock_steps == 2
    assert "line 3: time goes back by 1.500000 s" in log.warnings[0]
    assert "time goes back 2 times" in log.warnings[1]


@pytest.mark.parametrize("piece_bytes", [30, 1 << 19])
def test_a_time_beyond_64_bits_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, piece_bytes: int) -> None:
    monkeypatch.setattr(candump, "_PIECE_BYTES", piece_bytes)
    text = "(9223372035.0) can0 123#\n(0.0) can0 123#\n(9223372035.0) can0 123#\n"
    assert "line 3: expected times that go on, found them go back and forth over more than 292" in refusal(
        tmp_path, text
    )


def test_lines_in_no_order_of_time_are_refused(tmp_path: Path) -> None:
    times = [100 + 37 * k % 20 for k in range(60)]
    assert "sort its lines by their times" in refusal(
        tmp_path, "".join(f"(0000000{t}.000000) can0 123#\n" for t in times)
    )


def test_notes_of_dropped_frames(tmp_path: Path) -> None:
    note = "DROPCOUNT: dropped {} CAN frame{} on 'can0' socket (total drops {})\n"
    log = read(log_file(tmp_path, LINE + note.format(3, "s", 3) + LINE + note.format(1, "", 4)[:-1]))
    assert log.counters.frames == 2
    assert log.counters.dropped == 4
    assert "the kernel dropped 4 frames" in log.warnings[0]


# Both ways of reading, and python-can's


def test_ordinary_lines_are_all_read_the_fast_way() -> None:
    text = ordinary_text(2000).encode()
    buffer = np.frombuffer(bytes(PAD) + text + bytes(PAD), np.uint8)
    assert decode(buffer, PAD, PAD + len(text), TimeForm(10, 6)).ok.all()


def test_python_can_reads_the_same(tmp_path: Path) -> None:
    path = log_file(tmp_path, ordinary_text(2000))
    log = read(path)
    with can.CanutilsLogReader(str(path)) as reader:
        messages = list(reader)
    assert len(messages) == len(log.frames)
    for message, row in zip(messages, rows(log.frames, log.interfaces), strict=True):
        t_ns, name, can_id, dlc, data, flags = row
        assert (message.channel, message.arbitration_id, message.dlc) == (name, can_id, dlc)
        assert bytes(message.data) == data[:dlc]
        assert message.is_extended_id == bool(flags & EXTENDED)
        assert abs(message.timestamp - t_ns / 1e9) < 1e-6


def read_slowly(text: bytes) -> list[tuple[int, str, int, int, bytes, int]] | int:
    """The frames of whole lines one by one, or the number of the first bad line."""
    frames = []
    for number, line in enumerate(text.replace(b"\r\n", b"\n").split(b"\n")[:-1], 1):
        if not line.strip() or candump_line.dropped_frames(line) is not None:
            continue
        try:
            frame = candump_line.parse_line(line)
        except candump_line.BadLine:
            return number
        frames.append((frame.t_ns, frame.name, frame.can_id, frame.dlc, frame.data, frame.flags))
    return frames


def monotonic(frames: list[tuple[int, str, int, int, bytes, int]]) -> list[int]:
    """The times of `frames` without steps backwards."""
    times_ns = [frame[0] for frame in frames]
    steps_ns = [max(0, t - before) for before, t in itertools.pairwise(times_ns)]
    return list(itertools.accumulate(steps_ns, initial=times_ns[0]))


hexadecimal = st.sampled_from("0123456789ABCDEFabcdef")
times = st.one_of(
    st.integers(0, 2**51).map(lambda t_us: f"{t_us % 10**16 // 10**6:010d}.{t_us % 10**6:06d}"),
    st.from_regex(r"[0-9]{1,16}\.[0-9]{1,10}", fullmatch=True),
)
names = st.one_of(st.sampled_from(["can0", "vcan10", "  can0", "slcan1", "x" * 30]), st.text("abc#é \0", max_size=12))
identifiers = st.one_of(
    st.integers(0, 0x7FF).map("{:03X}".format),
    st.integers(0, 0x3FFFFFFF).map("{:08X}".format),
    st.text(hexadecimal, min_size=2, max_size=9),
)
payloads = st.one_of(
    st.binary(max_size=8).map(lambda data: data.hex().upper()),
    st.sampled_from(["R", "R4", "R9", "#1AABB", "#2", "1122334455667788_9", "R8_A", "11_9"]),
    st.text(hexadecimal, max_size=20),
)
lines = st.one_of(
    st.builds(
        "({}) {} {}#{}{}".format,
        times,
        names,
        identifiers,
        payloads,
        st.sampled_from(["", "", " R", " T", " "]),
    ),
    st.sampled_from(
        ["", LINE[:-1], "(1.5) can0 123#R", "DROPCOUNT: dropped 1 CAN frame on 'a' socket (total drops 1)"]
    ),
)
good_lines = lines.filter(lambda line: isinstance(read_slowly(line.encode() + b"\n"), list))


def check_fast_against_slow(folder: Path, text: bytes) -> None:
    expected = read_slowly(text)
    path = log_file(folder, text)
    if isinstance(expected, int):
        with pytest.raises(LogError, match=f"line {expected}: "):
            read(path)
    elif not expected:
        with pytest.raises(LogError, match=r"no frame in it|an empty file"):
            read(path)
    elif monotonic(expected)[-1] < 9.2e18:  # else it may be refused, as another test has it
        log = read(path)
        assert rows(log.frames, log.interfaces) == expected
        assert log.frames.t_mono_ns.tolist() == monotonic(expected)
        assert log.interfaces == tuple(dict.fromkeys(row[1] for row in expected))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("candump")


@settings(max_examples=300, deadline=None)
@given(st.lists(good_lines, max_size=12))
def test_fast_and_careful_reading_agree_on_good_lines(folder: Path, text: list[str]) -> None:
    check_fast_against_slow(folder, "".join(line + "\n" for line in text).encode())


@settings(max_examples=300, deadline=None)
@given(st.lists(good_lines, max_size=4), lines, st.lists(good_lines, max_size=4))
def test_fast_and_careful_reading_agree_on_damaged_lines(
    folder: Path, before: list[str], line: str, after: list[str]
) -> None:
    check_fast_against_slow(folder, "".join(f"{row}\n" for row in [*before, line, *after]).encode())


@settings(max_examples=1000, deadline=None)
@given(st.integers(0, 3 * len(LINE) - 2), st.integers(0, 255), st.booleans())
@example(len(LINE) + 19, 0, True)  # a character after the time that masks fill with as well
@example(2 * len(LINE) - 10, 0x67, False)  # "g", which counting nibbles alone would take
def test_one_wrong_byte_never_becomes_a_frame_that_careful_reading_would_not_see(
    folder: Path, place: int, byte: int, extended: bool
) -> None:
    line = LINE.replace("470#", "1ABCDEF0#") if extended else LINE
    text = bytearray((line * 3).encode())
    text[place] = byte
    check_fast_against_slow(folder, bytes(text))


@pytest.mark.parametrize("piece_bytes", [200, 256, 1000])
def test_lines_that_straddle_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, piece_bytes: int) -> None:
    text = ordinary_text(300) + LINE.replace("\n", "\r\n") * 20 + "(1.5) can0 123#R\n" * 3
    path = log_file(tmp_path, text)
    expected = read(path)
    monkeypatch.setattr(candump, "_PIECE_BYTES", piece_bytes)
    log = read(path)
    assert rows(log.frames, log.interfaces) == rows(expected.frames, expected.interfaces)
    assert log.frames.t_mono_ns.tolist() == expected.frames.t_mono_ns.tolist()
    assert log.warnings == expected.warnings
    assert "line 301: time goes back" in log.warnings[0]


def test_batches_of_a_reader_are_the_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(candump, "_PIECE_BYTES", 4096)
    monkeypatch.setattr(candump, "CHUNK_FRAMES", 500)
    path = log_file(tmp_path, ordinary_text(2000))
    with CandumpReader(path) as reader:
        batches = list(reader)
        assert all(500 <= len(batch) < 700 for batch in batches[:-1])
        assert reader.counters.frames == 2000
        whole = FrameBatch.concatenate(batches)
        assert rows(whole, reader.interfaces) == read_slowly(path.read_bytes())


# What is torn


@pytest.mark.parametrize("cut", range(1, len(LINE) - 1))
def test_a_torn_last_line_is_counted_and_left_out(tmp_path: Path, cut: int) -> None:
    log = read(log_file(tmp_path, LINE * 3 + LINE[:cut]))
    assert len(log.frames) == 3
    assert log.counters.torn == 1
    assert log.warnings == (
        f"{tmp_path / 'can.log'}: line 4 is torn, found {LINE[:cut].rstrip()!r}"
        + (" where the same identifier had 8 bytes before" if cut > 28 and cut % 2 == 1 else "")
        + "; the 3 frames before it are kept",
    )


def test_zeros_after_a_power_loss_are_a_torn_line(tmp_path: Path) -> None:
    log = read(log_file(tmp_path, LINE.encode() * 3 + b"(17415" + bytes(500)))
    assert len(log.frames) == 3
    assert log.counters.torn == 1


@pytest.mark.parametrize("lost_bytes", [1, 8, 200])
def test_a_truncated_gzip_is_read_up_to_its_end(tmp_path: Path, lost_bytes: int) -> None:
    text = ordinary_text(500)
    log = read(log_file(tmp_path, gzip.compress(text.encode())[:-lost_bytes], "can.log.gz"))
    assert 0 < len(log.frames) <= 500
    assert rows(log.frames, log.interfaces) == read_slowly(text.encode())[: len(log.frames)]
    assert log.counters.torn == 1
    assert "the compressed data stop before their end" in log.warnings[-1]
    assert f"the {len(log.frames)} frames before it are kept" in log.warnings[-1]


# Compressed files


@pytest.mark.parametrize("name", ["can.log.gz", "can.log"])
def test_gzip_is_known_by_its_bytes(tmp_path: Path, name: str) -> None:
    text = ordinary_text(300).encode()
    for compressed in (
        gzip.compress(text),
        gzip.compress(text[:5000]) + gzip.compress(text[5000:]) + bytes(512),
    ):
        log = read(log_file(tmp_path, compressed, name))
        assert rows(log.frames, log.interfaces) == read_slowly(text)
        assert log.warnings == ()


def test_damaged_gzip_is_refused(tmp_path: Path) -> None:
    compressed = bytearray(gzip.compress(ordinary_text(300).encode()))
    compressed[-6] ^= 1
    message = refusal(tmp_path, bytes(compressed))
    assert "expected whole compressed data, found it damaged" in message
    assert "copy the file again" in message


def test_the_error_of_zstd_without_its_module_names_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none_installed(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(candump_file.importlib, "import_module", none_installed)
    message = refusal(tmp_path, b"\x28\xb5\x2f\xfd" + bytes(20))
    assert "can.log: expected plain text or gzip, found zstd" in message
    assert "pip install zstandard" in message


def test_zstd_where_a_module_is_installed(tmp_path: Path) -> None:
    zstandard = pytest.importorskip("zstandard")
    text = ordinary_text(500).encode()
    compressed = zstandard.compress(text)
    log = read(log_file(tmp_path, compressed, "can.log.zst"))
    assert rows(log.frames, log.interfaces) == read_slowly(text)
    joined = read(log_file(tmp_path, compressed + compressed, "can.log.zst"))
    assert len(joined.frames) == 1000
    with pytest.raises(LogError, match=r"no frame in it|an empty file"):
        read(log_file(tmp_path, compressed[:100], "can.log.zst"))


# What is refused


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("1741532714.334381 can0 470#40", "a time in brackets first, as in (1741532714.334381)"),
        ("(1741532714) can0 470#40", "a time in brackets first"),
        ("(1741532714.1234567890) can0 470#40", "a time in brackets first"),
        ("(-1.000000) can0 470#40", "a time in brackets first"),
        ("(1741532714334.381000) can0 470#40", "a time in seconds before the year 2262"),
        ("(1741532714.334381)can0 470#40", "the name of an interface after the time"),
        ("(1741532714.334381) 470#40", "the name of an interface after the time"),
        ("(1741532714.334381) c\x01n0 470#40", "the name of an interface after the time"),
        ("(1741532714.334381) can0 47#40", "an identifier of 3 or 8 hexadecimal digits and #"),
        ("(1741532714.334381) can0 4700#40", "an identifier of 3 or 8 hexadecimal digits and #"),
        ("(1741532714.334381) can0 47G#40", "an identifier of 3 or 8 hexadecimal digits and #"),
        ("(1741532714.334381) can0 470 40", "an identifier of 3 or 8 hexadecimal digits and #"),
        ("(1741532714.334381) can0 800#40", "an identifier of 3 digits up to 7FF"),
        ("(1741532714.334381) can0 80000470#40", "an identifier of 8 digits up to 1FFFFFFF"),
        ("(1741532714.334381) can0 470#4", "0 to 8 bytes of two hexadecimal digits each after the #"),
        ("(1741532714.334381) can0 470#4X", "0 to 8 bytes of two hexadecimal digits each after the #"),
        ("(1741532714.334381) can0 470#112233445566778899", "0 to 8 bytes of two hexadecimal digits each"),
        ("(1741532714.334381) can0 470#R9", "0 to 8 bytes of two hexadecimal digits each"),
        ("(1741532714.334381) can0 470#40 X", "0 to 8 bytes of two hexadecimal digits each"),
        ("(1741532714.334381) can0 470#40_9", "a raw dlc (_9) only after 8 bytes"),
        (
            "(1741532714.334381) can0 470##0" + "AA" * 9,
            "0 to 8, 12, 16, 20, 24, 32, 48 or 64 bytes in a CAN FD frame, not 9",
        ),
        ("(1741532714.334381) can0 470#40\rEE", "0 to 8 bytes of two hexadecimal digits each"),
    ],
)
def test_a_bad_line_is_named_and_explained(tmp_path: Path, line: str, expected: str) -> None:
    message = refusal(tmp_path, f"{LINE * 2}\n{line}\n{LINE}")
    assert message.startswith(f"{tmp_path / 'can.log'}: line 4: expected {expected}")
    assert f"found {line[:60]!r}" in message.replace("\\\\", "\\")
    assert "take the line out, or record with 'candump -L'" in message


def test_the_first_of_several_bad_lines_is_named_in_any_piece(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(candump, "_PIECE_BYTES", 512)
    assert "line 41: " in refusal(tmp_path, LINE * 40 + "garbage\n" + LINE * 40 + "more garbage\n")


def test_a_log_of_one_bad_line_is_still_a_log(tmp_path: Path) -> None:
    assert "line 1: expected 0 to 8 bytes" in refusal(tmp_path, "(1741532714.334381) can0 470#4X\n" + LINE)
    assert "line 1: expected 0 to 8 bytes" in refusal(tmp_path, "(1741532714.334381) can0 470#4")


def test_empty_file_is_refused(tmp_path: Path) -> None:
    for text in (b"", gzip.compress(b"")):
        message = refusal(tmp_path, text)
        assert "can.log: expected a candump log, found an empty file" in message
        assert "check that the recording was running" in message
    assert "found no frame in it" in refusal(tmp_path, "\n\n")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (b"LOGG\x90\0\0\0" + bytes(100), "found Vector BLF"),
        (b"LOGG\x90\0\0\0\n" + bytes(100) + b"\n", "found Vector BLF"),
        (b"date Sun Mar 9 15:05:14.334 2025\nbase hex  timestamps absolute\n", "found Vector ASC"),
        (b";$FILEVERSION=2.1\n;   Start time\n", "found PEAK TRC"),
        (b"timestamp,arbitration_id,extended\n", "found CSV"),
        (b"\xd4\xc3\xb2\xa1\x02\0\x04\0" + bytes(600_000), "found pcap"),
        (b"\x0a\x0d\x0d\x0a\x1c\0\0\0" + bytes(100), "found pcapng"),
        (b"\xfd7zXZ\0\0\x04" + bytes(100), "found compressed with xz"),
        (bytes(range(11, 256)) + bytes(100) + b"\n" + LINE.encode(), "found binary data"),
        (b"hello\n", "found 'hello'"),
        (b"x" * 600_000, "found 'xxxxx"),
    ],
)
def test_another_kind_of_file(tmp_path: Path, text: bytes, expected: str) -> None:
    message = refusal(tmp_path, text)
    assert "this is not candump text: expected lines such as (1741532714.334381) can0 470#40EE" in message
    assert expected in message
    assert "can_logconvert" in message


@pytest.mark.parametrize(
    "line", ["  can0  470   [8]  40 EE EF F1 EF F1 F1 F0", " (1741532714.334381)  can0  470   [2]  40 EE"]
)
def test_the_screen_format_of_candump(tmp_path: Path, line: str) -> None:
    message = refusal(tmp_path, line + "\n")
    assert "line 1: expected candump's log format" in message
    assert "found its screen format" in message
    assert "record with 'candump -L' or 'candump -l'" in message


def test_a_line_without_end_in_a_log(tmp_path: Path) -> None:
    assert "line 2: expected lines of some 50 characters" in refusal(tmp_path, LINE.encode() + bytes(600_000))


def test_too_many_interfaces(tmp_path: Path) -> None:
    text = "".join(f"(0000000001.000000) can{i} 123#\n" for i in range(256))
    assert "line 256: expected at most 255 interfaces, found 'can255'" in refusal(tmp_path, text)


def test_a_file_that_cannot_be_opened(tmp_path: Path) -> None:
    for path in (tmp_path / "none.log", tmp_path):
        with pytest.raises(LogError) as caught:
            read(path)
        assert f"{path}: expected a candump log, found none that can be read" in str(caught.value)
        assert "check the path" in str(caught.value)
