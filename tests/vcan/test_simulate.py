"""`insole simulate` on a real vcan: its boards do what a host tells them."""

from __future__ import annotations

import subprocess
import sys
from collections import deque
from pathlib import Path

import can
import pytest

INSOLE = str(Path(sys.executable).with_name("insole"))
BOARDS = set(range(5, 11))
ANSWERS, READINGS = ({"can_id": kind, "can_mask": 0x700} for kind in (0x700, 0x400))

pytestmark = pytest.mark.vcan


@pytest.mark.timeout(300)
def test_boards_obey_a_host(vcan: str) -> None:
    """Each socket takes one kind of frame from the kernel, so that no reading pushes an answer out of a full queue.

    Only the test's own time ends the waiting: a kernel that has a tenth of a processor takes tens of seconds.
    """
    with (
        can.Bus(vcan, interface="socketcan", can_filters=[ANSWERS]) as host,
        can.Bus(vcan, interface="socketcan", can_filters=[READINGS]) as listener,
    ):
        played = subprocess.Popen(
            [INSOLE, "simulate", "stand", "--bus", f"socketcan:{vcan}"], stderr=subprocess.DEVNULL
        )
        try:
            listener.recv()  # the boards have come up
            host.send(can.Message(arbitration_id=0x70F, data=b"\xff", is_extended_id=False))
            answered: set[int] = set()
            while answered < BOARDS:
                message = host.recv()
                answered.add(message.arbitration_id >> 4 & 0xF)
            assert answered == BOARDS

            host.send(can.Message(arbitration_id=0x205, data=b"\x07\x01", is_extended_id=False))
            recent: deque[int] = deque(maxlen=200)
            while len(recent) < 200 or set(recent) != BOARDS - {5}:
                recent.append(listener.recv().arbitration_id >> 4 & 0xF)
        finally:
            played.terminate()
            assert played.wait() == 0
