"""Nothing but the allow-list leaves the process: every identifier and every first byte is tried."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import can
import numpy as np
import pytest

import insole_daemon
from insole_daemon.bus.frames import ERROR, EXTENDED, FD, REMOTE, FrameBatch
from insole_daemon.bus.gate import Gate
from insole_daemon.bus.recovering import RecoveringSource
from insole_daemon.bus.rules import check_may_leave, never_a_command, refusal
from insole_daemon.bus.sink import PythonCanSink, SocketCanSink
from insole_daemon.config import Bus, Config
from insole_daemon.errors import BusError
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.foot import Walk

# The longest way round the code under test: written out by hand, one good frame a command.
GOOD = {
    0x07: bytes.fromhex("07 00"),
    0x1C: bytes.fromhex("1C 02 00"),
    0x39: bytes.fromhex("39 01"),
    0x3A: bytes.fromhex("3A 01"),
    0x4D: bytes.fromhex("4D 00 14 F0"),
    0x50: bytes.fromhex("50 00 0F 03 00 00 22"),
}
ALLOWED = {(0x200 | address, payload) for address in range(1, 15) for payload in GOOD.values()}
ALLOWED.add((0x70F, b"\xff"))
FIRST_BYTES = [GOOD.get(first, bytes([first])) for first in range(256)]


class Sink:
    def __init__(self):
        self.sent = []

    def send(self, batch):
        assert not batch.flags.any()
        for row in range(len(batch)):
            self.sent.append((int(batch.can_id[row]), batch.data[row, : batch.dlc[row]].tobytes()))


def test_every_identifier_with_every_first_byte():
    sink = Sink()
    gate = Gate(lambda: sink, configure=True)
    for can_id, payload in itertools.product(range(1 << 11), FIRST_BYTES):
        try:
            gate.send(can_id, payload)
        except BusError:
            continue
    assert sorted(sink.sent) == sorted(ALLOWED)
    assert gate.sent == len(ALLOWED)
    assert gate.refused == (1 << 11) * 256 - len(ALLOWED)


def test_every_identifier_with_every_first_byte_at_every_length():
    passed = set()
    for dlc in range(9):
        payloads = [payload[:dlc].ljust(dlc, b"\0") for payload in FIRST_BYTES] if dlc else [b""]
        passed |= {
            (can_id, payload) for can_id in range(1 << 11) for payload in payloads if refusal(can_id, payload) is None
        }
    assert passed == ALLOWED


@pytest.mark.parametrize("flag", [EXTENDED, REMOTE, FD, ERROR])
def test_none_passes_that_is_no_standard_data_frame(flag):
    sink = Sink()
    gate = Gate(lambda: sink, configure=True)
    for can_id, payload in sorted(ALLOWED):
        with pytest.raises(BusError, match="only standard data frames"):
            gate.send(can_id, payload, flag)


def test_identifiers_beyond_11_bits_do_not_wrap_into_the_list():
    for can_id, payload in ALLOWED:
        for higher in (1 << 11, 1 << 16, 1 << 29, 1 << 31):
            assert refusal(can_id | higher, payload) is not None


@pytest.mark.parametrize(
    ("can_id", "payload", "why"),
    [
        (0x705, "00", "bootloader"),
        (0x70F, "00", "bootloader"),
        (0x705, "01 00 00", "flash"),
        (0x705, "02", "flash"),
        (0x705, "03", "flash"),
        (0x705, "04", "flash"),
        (0x70F, "04", "flash"),
        (0x705, "0D", "bootloader"),
        (0x705, "32 06", "address"),
        (0x205, "32 06", "address"),
        (0x20F, "32 06", "address"),
    ],
)
def test_fatal_commands_are_refused_by_name(can_id, payload, why):
    sink = Sink()
    gate = Gate(lambda: sink, configure=True)
    with pytest.raises(BusError, match=rf"{can_id:03X}.*is not sent: .*{why}"):
        gate.send(can_id, bytes.fromhex(payload))
    assert (sink.sent, gate.refused) == ([], 1)


@pytest.mark.parametrize(
    "payload",
    [
        "4D 04 14 F0", "4D 06 14 F0", "4D 09 14 F0",  # no such type
        "4D 00 00 F0", "4D 00 D2 F0", "4D 00 FF F0",  # 0, 210 and 255 ms
        "4D 00 14 00",  # no load at the count that means saturated
        "50 00 10 03 01 00 22", "50 03 02 03 01 00 22", "50 00 0F 08 01 00 22", "50 00 0F 03 02 00 22",
        "50 00 0F 03 01 40 22", "50 00 0F 03 01 00 62",
        "07 02", "07 FF", "39 00", "39 02",
        "CD 00 14 F0", "D0 00 0F 03 01 00 22", "87 00",  # an MTB4 reads these without their bit 7
        "4C 01 01 01 00 20 00 00", "4E 02 22 F0 00 FF FF 0A",  # the old ways to configure
    ],
)  # fmt: skip
def test_arguments_are_checked(payload):
    assert refusal(0x205, bytes.fromhex(payload)) is not None


def test_no_command_to_everyone_but_discovery():
    assert all(refusal(0x20F, payload) is not None for payload in GOOD.values())


def test_no_replayed_frame_is_a_command_for_any_identifier_and_first_byte():
    board_sends = {0x200 | address << 4 for address in range(1, 15)}  # its answers
    for dlc in (0, 1, 8):
        for first in range(256 if dlc else 1):
            can_id = np.arange(1 << 11, dtype=np.uint32)
            zero, nothing = np.zeros(1 << 11, np.int64), np.zeros(1 << 11, np.uint8)
            data = np.full((1 << 11, 8), first, np.uint8)
            frames = FrameBatch(zero, zero, nothing, can_id, np.full(1 << 11, dlc, np.uint8), data, nothing)
            passed = set(can_id[never_a_command(frames)].tolist())
            overflow = {0x705 | address << 4 for address in range(1, 15)} if dlc == 0 else set()
            assert {can_id for can_id in passed if can_id >> 8 in (2, 7)} == board_sends | overflow
            assert len(passed - board_sends - overflow) == 6 * 256, "what boards stream, and other nodes"


def test_of_class_7_boards_send_only_answers_to_discovery():
    for dlc, first in itertools.product(range(9), range(256)):
        passed = {
            can_id for can_id in np.flatnonzero(never_a_command(all_ids(dlc, first))).tolist() if can_id >> 8 == 7
        }
        if dlc in (4, 5) and first == 0xFF:
            assert passed == {0x700 | address << 4 for address in range(1, 15)}
        else:
            assert passed == ({0x705 | address << 4 for address in range(1, 15)} if dlc == 0 else set())


def test_only_standard_frames_are_replayed():
    n = 1 << 11
    zero, nothing = np.zeros(n, np.int64), np.zeros(n, np.uint8)
    ids, dlc, data = np.arange(n, dtype=np.uint32), np.full(n, 8, np.uint8), np.zeros((n, 8), np.uint8)
    of_boards = (ids >> 8 != 2) & (ids >> 8 != 7)
    for flags in range(1, 16):
        frames = FrameBatch(zero, zero, nothing, ids, dlc, data, np.full(n, flags, np.uint8))
        expected = of_boards if flags == REMOTE else np.zeros(n, np.bool_)
        assert np.array_equal(never_a_command(frames), expected), flags
    for higher in (1 << 11, 1 << 12, 1 << 16, 1 << 28, 1 << 31):  # beyond 11 bits without saying so
        frames = FrameBatch(zero, zero, nothing, ids | np.uint32(higher), dlc, data, nothing)
        assert not never_a_command(frames).any()


def test_no_frame_is_sent_unless_configured():
    sink = Sink()
    gate = Gate(lambda: sink, configure=False)
    for can_id, payload in sorted(ALLOWED):
        with pytest.raises(BusError, match=r"boards: \{configure: true\}"):
            gate.send(can_id, payload)
    assert (sink.sent, gate.refused) == ([], len(ALLOWED))


def test_sending_without_a_writable_bus_is_refused():
    gate = Gate(None, configure=True)
    with pytest.raises(BusError, match="does not read a bus that can be sent to"):
        gate.send(0x70F, b"\xff")


def test_the_gate_looks_up_its_sink_for_every_frame():
    first, second = Sink(), Sink()
    open_now = [first]

    def sink():
        if not open_now:
            raise BusError("nothing is sent: the interface went down")
        return open_now[0]

    gate = Gate(sink, configure=True)
    gate.send(0x70F, b"\xff")
    open_now.clear()
    for refused in (gate.check_open, lambda: gate.send(0x70F, b"\xff")):
        with pytest.raises(BusError, match="the interface went down"):
            refused()
    open_now.append(second)
    gate.send(0x205, bytes.fromhex("07 00"))
    assert (first.sent, second.sent) == ([(0x70F, b"\xff")], [(0x205, b"\x07\x00")])
    assert (gate.sent, gate.refused) == (2, 1)


def test_it_sends_on_the_bus_that_is_read():
    source = RecoveringSource([Bus("virtual", "test-gates")])
    with can.Bus(interface="virtual", channel="test-gates") as other:
        gate = Gate(lambda: source.sink("test-gates", 0.005), configure=True)
        gate.send(0x205, bytes.fromhex("07 00"))
        message = other.recv(5)
        assert (message.arbitration_id, bytes(message.data), message.is_extended_id) == (0x205, b"\x07\x00", False)
        other.send(can.Message(arbitration_id=0x450, data=[0x40] + [0] * 7, is_extended_id=False))
        while not source.receive():
            source.wait(0.1)
        assert source.drain().can_id.tolist() == [0x450], "what is sent there is not received there"
    source.close()


# ---- what leaves by whichever way: a sink is all there is between this process and a bus

# (class, first byte) that reboot a board into its bootloader, write its flash or rewrite its address
FATAL = [(7, first) for first in (0x00, 0x01, 0x02, 0x03, 0x04, 0x0D, 0x32)] + [(2, 0x32)]


def all_ids(dlc, first):
    """Every 11-bit identifier with one first byte, the rest of a good frame where there is one."""
    n, zero, nothing = 1 << 11, np.zeros(1 << 11, np.int64), np.zeros(1 << 11, np.uint8)
    data = np.zeros((n, 8), np.uint8)
    if dlc:
        data[:, :dlc] = np.frombuffer(GOOD.get(first, bytes([first]))[:dlc].ljust(dlc, b"\0"), np.uint8)
    ids = np.arange(n, dtype=np.uint32)
    return FrameBatch(zero, zero, nothing, ids, np.full(n, dlc, np.uint8), data, nothing)


def may_leave(frames):
    try:
        check_may_leave(frames)
    except BusError:
        return False
    return True


class Bus11:
    """Stands for a CAN socket and for a python-can bus."""

    def __init__(self):
        self.left = []

    def send(self, frame, *_, **__):
        self.left.append(frame)


@pytest.mark.parametrize("sink_of", [lambda bus: SocketCanSink(bus, "can0"), lambda bus: PythonCanSink(bus, "can0")])
def test_no_sink_sends_a_fatal_command(sink_of):
    for (cls, first), source, destination in itertools.product(FATAL, range(16), range(16)):
        answer = cls == 2 and destination == 0 and 1 <= source <= 14  # of a board, to the host
        for dlc in range(1, 9):
            bus = Bus11()
            can_id = cls << 8 | source << 4 | destination
            frame = all_ids(dlc, first)[can_id : can_id + 1]
            if answer:
                continue
            with pytest.raises(BusError, match="is not sent"):
                sink_of(bus).send(frame)
            assert bus.left == []


def test_a_sink_sends_only_listed_frames_for_every_identifier_first_byte_and_length():
    commands = set()
    for dlc, first in itertools.product(range(9), range(256)):
        if dlc == 0 and first:
            continue
        frames = all_ids(dlc, first)
        harmless = never_a_command(frames)
        assert may_leave(frames[harmless])
        for row in np.flatnonzero(~harmless).tolist():
            if refusal(row, frames.data[row, :dlc].tobytes()) is None:
                commands.add((row, frames.data[row, :dlc].tobytes()))
    assert commands == ALLOWED, "beside what no board obeys, the list and nothing else"
    for can_id, payload in sorted(ALLOWED):
        assert may_leave(all_ids(len(payload), payload[0])[can_id : can_id + 1])


def test_one_refused_frame_refuses_its_whole_batch():
    frames = all_ids(1, 0x32)
    for sink_of in (SocketCanSink, PythonCanSink):
        bus = Bus11()
        with pytest.raises(BusError, match=r"the frame 200 .*is not sent"):
            sink_of(bus, "can0").send(frames[0x1F8:0x208])
        assert bus.left == []


def test_nothing_but_the_sinks_writes_to_a_bus():
    package = Path(insole_daemon.__file__).parent
    source = {path.relative_to(package).as_posix(): path.read_text() for path in package.rglob("*.py")}
    of_can = {name for name, text in source.items() if re.search(r"^ *(import can\b|from can\b)", text, re.MULTILINE)}
    assert of_can == {
        "bus/pythoncan.py", "bus/sink.py", "bus/socketcan.py", "recording/import_can.py", "service/doctor/can.py",
    }  # fmt: skip
    assert {name for name, text in source.items() if "can.Message(" in text} == {"bus/sink.py"}
    assert {name for name, text in source.items() if "can_frames(" in text} == {"bus/sink.py"}
    for name in of_can - {"bus/sink.py"}:
        assert not re.search(r"\.send(to|msg|all|_periodic)?\(", source[name]), name
    raw = {name for name, text in source.items() if "CAN_RAW" in text}
    for name in raw - {"bus/sink.py"}:
        assert not re.search(r"\.(send(to|msg|all)?|write)\(", source[name]), name


def test_every_frame_of_emulated_boards_passes_the_gate():
    """Streams, and their answers to every command there is."""
    config = Config()
    layouts = [load_layout(insole) for insole in config.insoles]
    boards = Emulator(config, layouts, Walk(layouts), generation="mtb4").run(0)
    batches = [boards.advance(100_000_000)]
    for can_id, payload in sorted(ALLOWED):
        boards.obey(all_ids(len(payload), payload[0])[can_id : can_id + 1])
        batches.append(boards.advance(boards.now_ns + 5_000_000))
    batches.append(boards.advance(boards.now_ns + 2_000_000_000))  # their thermometers too
    frames = FrameBatch.concatenate(batches)
    assert {0x4, 0x2, 0x7, 0x3} <= set((frames.can_id >> 8).tolist())
    assert never_a_command(frames).all()
