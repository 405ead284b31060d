"""`insole simulate` on a real vcan: its boards do what a host tells them."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import can
import pytest

INSOLE = str(Path(sys.executable).with_name("insole"))

pytestmark = pytest.mark.vcan


@pytest.mark.timeout(120)
def test_boards_obey_a_host(vcan: str) -> None:
    with can.Bus(vcan, interface="socketcan") as host:
        played = subprocess.Popen(
            [INSOLE, "simulate", "stand", "--bus", f"socketcan:{vcan}", "--seconds", "20"], stderr=subprocess.DEVNULL
        )
        try:
            assert host.recv(60) is not None, "the boards have come up"
            host.send(can.Message(arbitration_id=0x70F, data=b"\xff", is_extended_id=False))
            host.send(can.Message(arbitration_id=0x205, data=b"\x07\x01", is_extended_id=False))
            answers, streaming, began = set(), set(), time.monotonic()
            while time.monotonic() < began + 6:
                message = host.recv(1)
                if message is None:
                    continue
                if message.arbitration_id >> 8 == 7:
                    answers.add(message.arbitration_id)
                elif message.arbitration_id >> 8 == 4 and time.monotonic() > began + 4:
                    streaming.add(message.arbitration_id >> 4 & 0xF)
        finally:
            played.terminate()
            assert played.wait(30) == 0
    assert answers >= {0x700 | address << 4 for address in range(5, 11)}
    assert streaming == {6, 7, 8, 9, 10}, "board 5 was told to stop"
