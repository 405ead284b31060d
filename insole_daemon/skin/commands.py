"""Commands to boards and their answers. Boards answer queries only; they never acknowledge settings.

    to               payload                                       effect or answer
    0x70F            FF                                            0x7A0: FF TYPE MAJ MIN [BUILD]
    0x200 | address  1C MAJOR MINOR                                0x2A0: 1C TYPE MAJ MIN BUILD PMAJ PMIN OK
                     4D TYPE PERIOD_ms NO_LOAD                     disables all triangles
                     50 FIRST LAST SHIFT ENABLE CDC_LOW CDC_HIGH   takes the baseline of ALL triangles of the board;
                                                                   an MTB4 is silent then until started
                     07 MODE                                       0 starts the stream, 1 stops it
                     39 01, 3A SECONDS                             0x3AE: 01 T_LOW T_HIGH 00 00, tenths of °C

A is the board's address in bits 7..4 of an answer. MTB4 knows all of it, MTB3 all but the thermometer.
Source: robotology/icub-firmware, embot_prot_can.cpp 339-369, embot_prot_can_analog_polling.cpp, mtb3
can_interface.c 300-309, 600-705; TSD-ICUBUNIT-canprotocol 3.1, 3.3.
"""

from __future__ import annotations

from collections.abc import Container, Iterable
from dataclasses import dataclass

from ..config import Board
from ..errors import BusError
from .identifiers import CLASS_LEGACY_SKIN, CLASS_MANAGEMENT, TYPE_THERMOMETER

CLASS_COMMAND = 2
EVERYONE = 0xF

BOARD_TYPES = {5: "MTB", 11: "MTB4", 15: "PSC", 16: "MTB4W", 20: "MTB4C"}  # iCubCanProto_types.h 60-86
WITHOUT_THERMOMETER = (5,)

SKIN_TYPES = (0, 1, 2, 3, 7, 8)
RAW_TEST_MODE = 7
PERIODS_MS = range(1, 210)  # an MTB3 counts period · 312.5 in 16 bits: above 209 ms it wraps; 0 is not known
CDC_OFFSET = 0x2200  # +34 steps of 0.32 pF: what every public configuration of triangles sets

_PROTOCOL = (2, 0)  # the version in the query; the answer has that of the board


@dataclass(frozen=True, slots=True)
class Command:
    """One frame to one board, or to all boards."""

    can_id: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class Identity:
    """Type and versions that a board reports."""

    board_type: int
    firmware: tuple[int, ...]  # major, minor, build
    protocol: tuple[int, int] | None = None  # of an answer to the version query
    bootloader: bool = False  # its application does not run

    @property
    def name(self) -> str:
        """Name of the type of board."""
        return BOARD_TYPES.get(self.board_type, f"type {self.board_type}")


def discovery() -> Command:
    """Return the command that asks every board for its identity."""
    return Command(CLASS_MANAGEMENT << 8 | EVERYONE, b"\xff")


def version_query(address: int) -> Command:
    """Return the command that asks a board for its firmware and protocol versions."""
    return _command(address, 0x1C, *_PROTOCOL)


def board_configuration(address: int, skin_type: int, period_ms: int, no_load: int) -> Command:
    """Return the command that sets temperature compensation, period and no-load; it disables all triangles."""
    _check(address, "skin_type", skin_type, SKIN_TYPES)
    _check(address, "period_ms", period_ms, PERIODS_MS)
    _check(address, "no_load", no_load, range(1, 256))
    return _command(address, 0x4D, skin_type, period_ms, no_load)


def triangle_configuration(
    address: int, first: int, last: int, shift: int, enable: bool, cdc_offset: int = CDC_OFFSET
) -> Command:
    """Return the command that enables or disables triangles `first` to `last`; the whole board takes a new baseline."""
    _check(address, "last triangle", last, range(16))
    _check(address, "first triangle", first, range(last + 1))
    _check(address, "shift", shift, range(8))
    if not 0 <= cdc_offset <= 0xFFFF or cdc_offset & 0x4040:
        raise BusError(f"board {address}: expected a CDC offset without bits 14 and 6, found {cdc_offset:#06x}")
    return _command(address, 0x50, first, last, shift, int(enable), cdc_offset & 0xFF, cdc_offset >> 8)


def transmit(address: int, on: bool) -> Command:
    """Return the command that starts or stops the stream (in the frame, 0 starts)."""
    return _command(address, 0x07, 0 if on else 1)


def thermometer_configuration(address: int) -> Command:
    """Return the command that selects the one thermometer of an MTB4."""
    return _command(address, 0x39, 1)


def thermometer_period(address: int, seconds: int) -> Command:
    """Return the command that makes a board send its temperature every `seconds`; 0 stops it."""
    _check(address, "seconds", seconds, range(256))
    return _command(address, 0x3A, seconds)


def configuration(board: Board, triangles: Iterable[int]) -> tuple[list[Command], list[Command]]:
    """Return all commands that configure `board` with `triangles` enabled, and those to repeat afterwards.

    Repeat them at least 100 ms later: an MTB4 takes its baseline without waiting for the first conversion (37 ms) with
    the new settings, so its first baseline is wrong (robotology/icub-firmware#671).
    """
    address = board.address
    enabling = [
        triangle_configuration(address, first, last, board.shift, True) for first, last in contiguous_ranges(triangles)
    ]
    return [
        board_configuration(address, board.skin_type, board.period_ms, board.no_load),
        triangle_configuration(address, 0, 15, board.shift, False),
        *enabling,
    ], enabling


def contiguous_ranges(triangles: Iterable[int]) -> list[tuple[int, int]]:
    """Return the first and last number of each contiguous range of `triangles`."""
    ranges: list[tuple[int, int]] = []
    for triangle in sorted(set(triangles)):
        if ranges and triangle == ranges[-1][1] + 1:
            ranges[-1] = ranges[-1][0], triangle
        else:
            ranges.append((triangle, triangle))
    return ranges


def read_discovery(can_id: int, payload: bytes) -> tuple[int, Identity] | None:
    """Return (address, identity) of an answer to discovery, or None for any other frame."""
    if can_id & 0x70F != CLASS_MANAGEMENT << 8 or len(payload) not in (4, 5) or payload[0] != 0xFF:
        return None
    return can_id >> 4 & 0xF, Identity(payload[1], tuple(payload[2:]), bootloader=len(payload) == 4)


def read_version(can_id: int, payload: bytes) -> tuple[int, Identity] | None:
    """Return (address, identity) of an answer to the version query, or None for any other frame."""
    if can_id & 0x70F != CLASS_COMMAND << 8 or len(payload) != 8 or payload[0] != 0x1C:
        return None
    return can_id >> 4 & 0xF, Identity(payload[1], tuple(payload[2:5]), (payload[5], payload[6]))


def read_temperature(can_id: int, payload: bytes) -> tuple[int, float] | None:
    """Return (address, °C) of a thermometer's frame, or None for any other frame."""
    if can_id & 0x70F != CLASS_LEGACY_SKIN << 8 | TYPE_THERMOMETER or len(payload) != 5 or payload[0] != 1:
        return None
    return can_id >> 4 & 0xF, int.from_bytes(payload[1:3], "little", signed=True) / 10


def _command(address: int, *payload: int) -> Command:
    if not 1 <= address <= 14:
        raise BusError(f"expected the address of a board, 1 to 14, found {address}")
    return Command(CLASS_COMMAND << 8 | address, bytes(payload))


def _check(address: int, name: str, value: int, allowed: Container[int]) -> None:
    if value not in allowed:
        words = f"{allowed[0]} to {allowed[-1]}" if isinstance(allowed, range) and allowed else f"one of {allowed}"
        raise BusError(f"board {address}: {name}: boards take {words}, found {value}: correct it in the configuration")
