"""The frames that may leave this process on a bus; every sink checks them here.

A frame may leave if no board can take it for a command, such as those of simulated or replayed boards, or if it is one
of the commands on this list. A replay does not even send those (`never_a_command`).

    id               payload                                       what it does
    0x70F            FF                                            discovery: every board says what it is
    0x200 | address  07 MODE                                       start (0) or stop (1) the stream
                     1C MAJOR MINOR                                version query
                     39 01                                         thermometer: configure
                     3A SECONDS                                    thermometer: send every SECONDS, 0 stops
                     4D TYPE PERIOD NO_LOAD                        board configuration
                     50 FIRST LAST SHIFT ENABLE CDC_LOW CDC_HIGH   triangle configuration

Everything else is refused: the same buses carry commands that reboot a board into its bootloader, erase its flash or
rewrite its address. The list repeats what skin.commands encodes on purpose, so that a mistake there does not pass here.

Source: robotology/icub-firmware, embot_prot_can_analog_polling.cpp, mtb3 can_interface.c; TSD-ICUBUNIT-canprotocol.
"""

from __future__ import annotations

from collections.abc import Container

import numpy as np
from numpy.typing import NDArray

from ..errors import BusError
from .frames import ERROR, EXTENDED, FD, FrameBatch

_BYTE = range(256)
_CDC_OFFSET = frozenset(byte for byte in _BYTE if not byte & 0x40)  # AD7147: bits 14 and 6 have no meaning

_DISCOVERY_ID, _DISCOVERY = 0x70F, b"\xff"
_COMMAND_IDS = range(0x201, 0x20F)  # 0 is the host, 15 everyone: a command always means one board
_COMMANDS: dict[int, tuple[Container[int], ...]] = {  # first byte → allowed values of the bytes after it
    0x07: (range(2),),
    0x1C: (_BYTE, _BYTE),
    0x39: (range(1, 2),),
    0x3A: (_BYTE,),
    0x4D: ((0, 1, 2, 3, 7, 8), range(1, 210), range(1, 256)),  # above 209 ms an MTB3's register wraps
    0x50: (range(16), range(16), range(8), range(2), _CDC_OFFSET, _CDC_OFFSET),
}
_DANGER = {  # (class, first byte) of forbidden commands → the reason
    (7, 0x00): "it reboots a board into its bootloader",
    (7, 0x01): "it writes a board's flash",
    (7, 0x02): "it writes a board's flash",
    (7, 0x03): "it writes a board's flash",
    (7, 0x04): "it writes a board's flash",
    (7, 0x0D): "it is a command of the bootloader",
    (7, 0x32): "it rewrites a board's address",
    (2, 0x32): "it rewrites a board's address",
}
_OTHER_ID = "only 0x201 to 0x20E (a command to one board) and 0x70F (discovery) may be sent"
_NO_STANDARD_FRAME = "only standard data frames may be sent"


def refusal(can_id: int, payload: bytes, flags: int = 0) -> str | None:
    """Return why this frame may not be sent, None if it may; `flags` as in FrameBatch."""
    if flags:
        return _NO_STANDARD_FRAME
    if can_id == _DISCOVERY_ID:
        return None if payload == _DISCOVERY else _danger(7, payload) or "on 0x70F only FF (discovery) may be sent"
    if can_id not in _COMMAND_IDS:
        return _danger(can_id >> 8, payload) or _OTHER_ID
    arguments = _COMMANDS.get(payload[0]) if payload else None
    if arguments is None:
        return _danger(2, payload) or "its first byte is none of " + " ".join(f"{code:02X}" for code in _COMMANDS)
    if len(payload) != 1 + len(arguments):
        return f"command {payload[0]:02X} has {1 + len(arguments)} bytes, found {len(payload)}"
    for place, allowed in enumerate(arguments, 1):
        if payload[place] not in allowed:
            return f"byte {place} of command {payload[0]:02X} may not be {payload[place]:02X}"
    if payload[0] == 0x50 and payload[1] > payload[2]:
        return f"the first triangle {payload[1]} comes after the last {payload[2]}"
    return None


def never_a_command(frames: FrameBatch) -> NDArray[np.bool_]:
    """Return which frames no board can take for a command, (n,): those of boards and of other nodes.

    Boards receive commands in classes 2 and 7; they ignore 29-bit identifiers and CAN FD. Of these classes only frames
    of boards pass: answers to the host (class 2, destination 0; in class 7 only those to discovery, FF), and an MTB3's
    notice that it dropped its queue (class 7, type 5, no payload).
    """
    cls, source, destination = frames.can_id >> 8, frames.can_id >> 4 & 0xF, frames.can_id & 0xF
    is_from_board = (frames.flags == 0) & (source >= 1) & (source <= 14)
    answer = is_from_board & (cls == 2) & (destination == 0)
    identity = is_from_board & (cls == 7) & (destination == 0) & (frames.data[:, 0] == 0xFF)
    identity &= (frames.dlc == 4) | (frames.dlc == 5)
    overflow = is_from_board & (cls == 7) & (destination == 5) & (frames.dlc == 0)
    standard = (frames.flags & (ERROR | FD | EXTENDED) == 0) & (cls < 8)
    passes: NDArray[np.bool_] = standard & ((cls != 2) & (cls != 7) | answer | identity | overflow)
    return passes


def _danger(cls: int, payload: bytes) -> str | None:
    return _DANGER.get((cls, payload[0])) if payload else None


def check_may_leave(frames: FrameBatch) -> None:
    """Raise BusError if a frame may be taken for a command and is not on the list."""
    for row in np.flatnonzero(~never_a_command(frames)).tolist():
        can_id, payload = int(frames.can_id[row]), frames.data[row, : frames.dlc[row]].tobytes()
        why = refusal(can_id, payload, int(frames.flags[row]))
        if why is not None:
            raise not_sent(can_id, payload, why)


def not_sent(can_id: int, payload: bytes, why: str) -> BusError:
    """Return the error for a frame that may not be sent."""
    return BusError(f"the frame {can_id:03X} [{payload.hex(' ').upper()}] is not sent: {why}")
