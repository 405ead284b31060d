"""The 11-bit identifiers and the first payload byte of the skin protocol.

    id    10 9 8   7 6 5 4   3 2 1 0
          class    source    type / destination

A triangle's data are in two frames with the same identifier, distinguished by payload byte 0:

    byte     0     1    2    3    4    5    6            7
    half A   0x40  t0   t1   t2   t3   t4   t5           t6 (thermal pad)
    half B   0xC0  t7   t8   t9   t10  t11  status high  status low

Source: robotology/icub-firmware, embot_prot_can_skin_periodic.cpp and TSD-ICUBUNIT-canprotocol 4.3.1.
"""

from __future__ import annotations

CLASS_LEGACY_SKIN = 3  # an MTB3 that was never configured in the new style; also the MTB4's thermometer
CLASS_SKIN = 4
CLASS_SECOND_HALF = 6  # one special MTB4 build sends its half B here
CLASS_MANAGEMENT = 7

TAG_A = 0x40
TAG_B = 0xC0

TYPE_OVERFLOW = 5  # class 7, no payload: an MTB3 dropped its transmit queue
TYPE_THERMOMETER = 0xE  # class 3, 5 bytes

ERROR_NO_ACK = 1  # low nibble of the status: some channel reads 0 while its baseline is not 0
ERROR_NOT_CONNECTED = 2  # all twelve raw words are 0xFFFF


def skin_id(board: int, triangle: int, cls: int = CLASS_SKIN) -> int:
    """Return the identifier of the halves of (board, triangle)."""
    return cls << 8 | board << 4 | triangle
