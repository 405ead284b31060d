"""The commands an emulated MTB4 obeys, and what it answers.

    to               payload                            effect or answer
    0x200 | address  4D TYPE PERIOD NO_LOAD             settings; all triangles disabled
                     50 FIRST LAST SHIFT ENABLE CDC…    settings; stops the stream, takes the baseline
                     07 MODE                            0 starts the stream, anything else stops it
                     1C MAJOR MINOR                     0x2A0: 1C TYPE MAJ MIN BUILD PMAJ PMIN OK
    0x700 | address  FF                                 0x7A0: FF TYPE MAJ MIN BUILD

The address 0xF is everyone's. The rest is ignored, as is a command that is too short, and the converter
offset CDC: the emulated sensors have none. Source: robotology/icub-firmware, embot_prot_can.cpp 100–129 and
339–369, embot_app_application_theSkin.cpp 234–285 and 640–670.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..skin.identifiers import CLASS_MANAGEMENT
from .board import Board

CLASS_COMMAND = 2
BOARD_CONFIG = 0x4D
TRIANGLE_CONFIG = 0x50
TX_MODE = 0x07
VERSION = 0x1C
DISCOVER = 0xFF

_EVERYONE = 0xF
_MTB4 = 11
_APPLICATION = (1, 25, 0)
_PROTOCOL = (2, 0)


def obey(
    board: Board, can_id: int, payload: bytes, t_ns: int, pressure_pa: NDArray[np.float64]
) -> tuple[int, bytes] | None:
    """Let `board` act on a frame received at `t_ns` under `pressure_pa` (n_triangles, 12).

    The identifier and payload of its answer, if it gives one.
    """
    cls, source, destination = can_id >> 8, can_id >> 4 & 0xF, can_id & 0xF
    if destination not in (board.address, _EVERYONE) or not payload:
        return None
    answer_id = cls << 8 | board.address << 4 | source
    if cls == CLASS_MANAGEMENT and payload[0] == DISCOVER:
        return answer_id, bytes([DISCOVER, _MTB4, *_APPLICATION])
    if cls != CLASS_COMMAND:
        return None
    code, arguments = payload[0] & 0x7F, payload[1:]
    if code == VERSION and len(arguments) >= 2:
        fits = arguments[0] == _PROTOCOL[0] and _PROTOCOL[1] >= arguments[1]
        return answer_id, bytes([VERSION, _MTB4, *_APPLICATION, *_PROTOCOL, fits])
    _set(board, code, arguments, t_ns, pressure_pa)
    return None


def _set(board: Board, code: int, arguments: bytes, t_ns: int, pressure_pa: NDArray[np.float64]) -> None:
    """The skin commands: none is acknowledged, and the first one makes a board take its baseline."""
    wanted = {BOARD_CONFIG: 3, TRIANGLE_CONFIG: 6, TX_MODE: 1}
    if code not in wanted or len(arguments) < wanted[code]:
        return
    if not board.zeroed:
        board.zero(pressure_pa)
    if code == BOARD_CONFIG:
        skin_type, period_ms, no_load = arguments[:3]
        board.configure(skin_type, period_ms, no_load, t_ns)
    elif code == TX_MODE:
        board.transmit(arguments[0] == 0, t_ns)
    else:
        first, last, shift, enable = arguments[:4]
        if first <= last <= 15:
            board.shift[first : last + 1] = min(shift, 31)  # beyond 31 bits the firmware's C says nothing
            board.enable(range(first, last + 1), bool(enable & 1))
            board.transmit(False, t_ns)
            board.zero(pressure_pa)
