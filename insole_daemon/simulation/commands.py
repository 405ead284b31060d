"""The commands that an emulated board obeys, and its answers.

    to               payload                            effect or answer
    0x200 | address  4D TYPE PERIOD NO_LOAD             settings; all triangles disabled
                     50 FIRST LAST SHIFT ENABLE CDC…    settings; stops the stream, takes the baseline
                     07 MODE                            0 starts the stream, anything else stops it
                     1C MAJOR MINOR                     0x2A0: 1C TYPE MAJ MIN BUILD PMAJ PMIN OK
                     4C MODE … TIMER CDC CDC T T        legacy: settings, takes the baseline, starts the stream
                     4E SHIFT … NO_LOAD FLAGS ENA ENA   legacy, MTB3: settings, takes the baseline
                     39 01 and 3A SECONDS               MTB4: see thermometer.py
    0x700 | address  FF                                 0x7A0: FF TYPE MAJ MIN BUILD

The address 0xF addresses all boards, on an MTB3 only in class 7. All other commands are ignored, as are commands that
are too short and the converter offset CDC, which the emulated sensors do not have. Of the modes of 4C only the default
one, twelve taxels of 8 bits, is emulated. Source: robotology/icub-firmware, embot_prot_can.cpp 100–129 and 339–369,
embot_app_application_theSkin.cpp 234–285 and 640–764, mtb3/can_interface.c 63–75 and 388–705.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..skin.identifiers import CLASS_MANAGEMENT
from .board import EmulatedBoard

CLASS_COMMAND = 2
BOARD_CONFIG = 0x4D
TRIANGLE_CONFIG = 0x50
TX_MODE = 0x07
VERSION = 0x1C
DISCOVER = 0xFF
TACT_SETUP = 0x4C
TACT_SETUP_2 = 0x4E
THERMOMETER_CONFIG = 0x39
THERMOMETER_START = 0x3A

_EVERYONE = 0xF
_MIN_ARGUMENTS = {  # bytes after the code
    BOARD_CONFIG: 3, TRIANGLE_CONFIG: 6, TX_MODE: 1, TACT_SETUP: 7, TACT_SETUP_2: 6,
    THERMOMETER_CONFIG: 1, THERMOMETER_START: 1,
}  # fmt: skip
_TWELVE_OF_8_BITS = 0x01
_OWN_TIMER = 3
_TIMER_TICK_NS = 3200
_LEGACY_MTB3_NS, _LEGACY_MTB4_NS = 50_000_000, 40_000_000
_COMPENSATES, _NO_COMPENSATION = 0x08, 2


def obey(
    board: EmulatedBoard, can_id: int, payload: bytes, t_ns: int, pressure_pa: NDArray[np.float64]
) -> tuple[int, bytes] | None:
    """Let `board` act on a frame received at `t_ns` under `pressure_pa` (n_triangles, 12).

    Return identifier and payload of its answer, or None.
    """
    kind = board.generation
    cls, source, destination = can_id >> 8, can_id >> 4 & 0xF, can_id & 0xF
    if not payload or destination not in (board.address, _EVERYONE):
        return None
    answer_id = cls << 8 | board.address << 4 | source
    if cls == CLASS_MANAGEMENT and payload[0] == DISCOVER:
        return answer_id, bytes([DISCOVER, kind.board_type, *kind.application])
    if cls != CLASS_COMMAND or (destination == _EVERYONE and not kind.class_2_for_all):
        return None
    code, arguments = payload[0] & kind.code_mask, payload[1:]
    if code == VERSION and len(arguments) >= 2:
        requested, supported = tuple(arguments[:2]), kind.protocol
        is_supported = requested == supported or (
            kind.any_minor and requested[0] == supported[0] and supported[1] >= requested[1]
        )
        return answer_id, bytes([VERSION, kind.board_type, *kind.application, *supported, is_supported])
    if len(arguments) >= _MIN_ARGUMENTS.get(code, 8):
        if code in (THERMOMETER_CONFIG, THERMOMETER_START):
            _command_thermometer(board, code, arguments[0], t_ns)
        elif code != TACT_SETUP_2 or kind.legacy_stream:
            _apply_settings(board, code, arguments, t_ns, pressure_pa)
    return None


def _command_thermometer(board: EmulatedBoard, code: int, argument: int, t_ns: int) -> None:
    if not board.generation.thermometer:
        return
    if code == THERMOMETER_CONFIG:
        board.thermometer.configure(argument)
    else:
        board.thermometer.start(argument, t_ns)


def _apply_settings(
    board: EmulatedBoard, code: int, arguments: bytes, t_ns: int, pressure_pa: NDArray[np.float64]
) -> None:
    """Apply a skin command: none is acknowledged, and the first one makes an MTB4 take its baseline."""
    if not board.zeroed and not board.generation.calibrates_in_ticks:
        board.zero(pressure_pa, t_ns)
    if code == BOARD_CONFIG:
        skin_type, period_ms, no_load = arguments[:3]
        board.configure(skin_type, period_ms, no_load, t_ns)
    elif code == TX_MODE:
        is_on = arguments[0] == 0
        if is_on:
            board.use_skin_class()
        board.transmit(is_on, t_ns)
    elif code == TRIANGLE_CONFIG:
        first, last, shift, enable = arguments[:4]
        if first <= last <= 15:
            board.use_skin_class()
            board.shift[first : last + 1] = min(shift, 31)  # a shift above 31 bits is undefined in C
            board.enable(range(first, last + 1), bool(enable & 1))
            board.calibrate(t_ns, pressure_pa)
    elif code == TACT_SETUP:
        _set_up_legacy(board, arguments, t_ns, pressure_pa)
    else:
        shift, _, no_load, flags = arguments[:4]
        board.shift[:] = shift & 0xF
        board.no_load = no_load
        board.skin_type = flags & 3 if flags & _COMPENSATES else _NO_COMPENSATION
        enabled = int.from_bytes(arguments[4:6], "little")
        for triangle in range(16):
            board.enable([triangle], bool(enabled >> triangle & 1))
        board.calibrate(t_ns, pressure_pa)


def _set_up_legacy(board: EmulatedBoard, arguments: bytes, t_ns: int, pressure_pa: NDArray[np.float64]) -> None:
    """Apply 4C: an MTB4 takes its defaults whatever the arguments are, an MTB3 takes the period from them."""
    if board.generation.legacy_stream:
        if arguments[0] != _TWELVE_OF_8_BITS:
            return
        is_own_timer = arguments[2] & 0xF == _OWN_TIMER
        ticks = int.from_bytes(arguments[5:7], "little")
        board.set_timer_ns(ticks * _TIMER_TICK_NS if is_own_timer else _LEGACY_MTB3_NS)
    else:
        board.no_load, board.skin_type = 245, 0
        board.enable(range(16), True)
        board.set_timer_ns(_LEGACY_MTB4_NS)
        board.zero(pressure_pa, t_ns)
    board.transmit(True, t_ns)
    if board.generation.calibrates_in_ticks:
        board.calibrate(t_ns, pressure_pa)
