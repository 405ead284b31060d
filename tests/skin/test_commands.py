"""Commands against the protocol document's own examples, and every one of them against the gate."""

from __future__ import annotations

import itertools

import pytest

from insole_daemon.bus.rules import refusal
from insole_daemon.config import Board
from insole_daemon.errors import BusError
from insole_daemon.skin import commands


def test_the_session_the_protocol_document_prints():
    """Board 5, 50 ms, no-load 245, shift 2: TSD-ICUBUNIT-canprotocol 7.7."""
    board = Board(address=5, interface="can0", period_ms=50, shift=2, no_load=245)
    first, again = commands.configuration(board, [0, 1])
    sent = [*first, commands.transmit(5, True), commands.transmit(5, False)]
    assert {command.can_id for command in sent} == {0x205}
    assert [command.payload.hex(" ").upper() for command in sent] == [
        "4D 00 32 F5",
        "50 00 0F 02 00 00 22",
        "50 00 01 02 01 00 22",
        "07 00",
        "07 01",
    ]
    assert again == [first[2]]


def test_absent_triangles_stay_disabled():
    board = Board(address=5, interface="can0")
    first, again = commands.configuration(board, (0, 1, 4, 6, 8, 9, 10, 11, 12, 13, 14, 15))
    assert [tuple(command.payload[1:3]) for command in again] == [(0, 1), (4, 4), (6, 6), (8, 15)]
    assert first[2:] == again


def test_the_thermometers_commands():
    """embot_prot_can_analog_polling.cpp: 0x39 which thermometers (a mask), 0x3A the period in seconds."""
    assert commands.thermometer_configuration(3) == commands.Command(0x203, b"\x39\x01")
    assert commands.thermometer_period(14, 5) == commands.Command(0x20E, b"\x3a\x05")
    assert commands.version_query(1) == commands.Command(0x201, b"\x1c\x02\x00")
    assert commands.discovery() == commands.Command(0x70F, b"\xff")


def test_triangles_become_contiguous_ranges():
    assert commands.contiguous_ranges([]) == []
    assert commands.contiguous_ranges([3, 1, 2, 2, 7]) == [(1, 3), (7, 7)]


def test_everything_encoded_passes_the_gate():
    sent = [commands.discovery()]
    for address in range(1, 15):
        sent += [
            commands.version_query(address),
            commands.transmit(address, True),
            commands.transmit(address, False),
            commands.thermometer_configuration(address),
            *(commands.thermometer_period(address, s) for s in (0, 1, 255)),
        ]
        for skin_type, period_ms, no_load in itertools.product(commands.SKIN_TYPES, (1, 209), (1, 255)):
            sent.append(commands.board_configuration(address, skin_type, period_ms, no_load))
        for first, last in itertools.combinations_with_replacement(range(16), 2):
            for shift, enable in itertools.product(range(8), (True, False)):
                sent.append(commands.triangle_configuration(address, first, last, shift, enable))
    assert [refusal(command.can_id, command.payload) for command in sent] == [None] * len(sent)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: commands.version_query(0), "1 to 14, found 0"),
        (lambda: commands.version_query(15), "1 to 14, found 15"),
        (lambda: commands.board_configuration(5, 4, 20, 240), r"skin_type: boards take one of \(0, 1, 2, 3, 7, 8\)"),
        (lambda: commands.board_configuration(5, 0, 0, 240), "period_ms: boards take 1 to 209, found 0"),
        (lambda: commands.board_configuration(5, 0, 210, 240), "period_ms: boards take 1 to 209, found 210"),
        (lambda: commands.board_configuration(5, 0, 20, 256), "no_load"),
        (
            lambda: commands.triangle_configuration(5, 0, 16, 3, True),
            "^board 5: last triangle: boards take 0 to 15, found 16",
        ),
        (lambda: commands.triangle_configuration(5, 3, 2, 3, True), "first triangle"),
        (lambda: commands.triangle_configuration(5, 0, 15, 8, True), "shift: boards take 0 to 7, found 8"),
        (lambda: commands.triangle_configuration(5, 0, 15, 3, True, 0x4000), "CDC offset"),
        (lambda: commands.thermometer_period(5, 256), "^board 5: seconds: boards take 0 to 255, found 256"),
    ],
)
def test_arguments_out_of_range(make, words):
    with pytest.raises(BusError, match=words):
        make()


def test_answers_of_boards_are_parsed():
    mtb4 = bytes.fromhex("FF 0B 01 19 00")
    address, identity = commands.read_discovery(0x750, mtb4)
    assert (address, identity.name, identity.firmware, identity.bootloader) == (5, "MTB4", (1, 25, 0), False)
    assert commands.read_discovery(0x750, mtb4[:4])[1].bootloader
    address, identity = commands.read_version(0x2E0, bytes.fromhex("1C 05 02 11 00 01 02 03"))
    assert (address, identity.name, identity.firmware, identity.protocol) == (14, "MTB", (2, 17, 0), (1, 2))
    assert commands.read_temperature(0x35E, bytes.fromhex("01 01 01 00 00")) == (5, 25.7)
    assert commands.read_temperature(0x35E, bytes.fromhex("01 FB FF 00 00")) == (5, -0.5)
    assert commands.Identity(99, (1,)).name == "type 99"


@pytest.mark.parametrize(
    ("read", "can_id", "payload"),
    [
        (commands.read_discovery, 0x70F, "FF"),  # our own question
        (commands.read_discovery, 0x755, ""),  # an MTB3's overflow
        (commands.read_discovery, 0x250, "FF 0B 01 19 00"),
        (commands.read_version, 0x205, "1C 02 00"),  # our own question
        (commands.read_version, 0x205, "1C 0B 01 19 00 02 00 01"),
        (commands.read_version, 0x250, "1C 0B 01"),
        (commands.read_temperature, 0x35E, "40 F0 F0 F0 F0 F0 F0 F0"),  # triangle 14 of an MTB3
        (commands.read_temperature, 0x45E, "01 01 01 00 00"),
        # of the right length and another first byte, and the other way round
        (commands.read_discovery, 0x750, "FE 0B 01 19 00"),
        (commands.read_discovery, 0x750, "FF 0B 01"),
        (commands.read_version, 0x250, "1D 0B 01 19 00 02 00 01"),
        (commands.read_temperature, 0x35E, "02 01 01 00 00"),
        (commands.read_temperature, 0x35E, "01 01 01 00"),
    ],
)
def test_other_frames_are_not_parsed_as_answers(read, can_id, payload):
    assert read(can_id, bytes.fromhex(payload)) is None
