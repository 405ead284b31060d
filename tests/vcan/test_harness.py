"""The ground the other tests here stand on: a kernel's real CAN sockets, canplayer, and Zenoh beside them."""

from __future__ import annotations

import re
import shutil
import socket
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from tests.ports import free_port

pytestmark = pytest.mark.vcan

# One board's first triangle, both halves, and an empty frame; stamps 1 ms apart.
LOG = """\
(1700000000.000000) can0 450#40F0F0F0F0F0F0F0
(1700000000.001000) can0 450#C0F0F0F0F0F00000
(1700000000.002000) can0 451#4001020304050607
(1700000000.003000) can0 755#
"""
FRAME = struct.Struct("=IB3x8s")  # struct can_frame
SO_TIMESTAMPNS = getattr(socket, "SO_TIMESTAMPNS", 35)  # Python 3.11 does not name it


def frames_of(log: str) -> list[tuple[int, bytes]]:
    return [(int(i, 16), bytes.fromhex(data)) for i, data in re.findall(r" (\w+)#(\w*)$", log, re.MULTILINE)]


def receive(bus: socket.socket) -> tuple[int, bytes, int]:
    """Identifier, data and the kernel's receive time in ns of the next frame."""
    frame, ancillary, _, _ = bus.recvmsg(FRAME.size, socket.CMSG_SPACE(16))
    identifier, length, data = FRAME.unpack(frame)
    ((level, kind, stamp),) = ancillary
    assert (level, kind) == (socket.SOL_SOCKET, SO_TIMESTAMPNS)
    seconds, nanoseconds = struct.unpack("=qq", stamp)
    return identifier, data[:length], seconds * 10**9 + nanoseconds


def test_canplayer_log_arrives_frame_by_frame(vcan: str, tmp_path: Path) -> None:
    assert shutil.which("canplayer"), "apt-get install can-utils"
    log = tmp_path / "can.log"
    log.write_text(LOG)
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as bus:
        bus.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        bus.settimeout(5)
        bus.bind((vcan,))
        subprocess.run(["canplayer", "-I", log, f"{vcan}=can0"], check=True, timeout=30)
        received = [receive(bus) for _ in frames_of(LOG)]
        bus.settimeout(0.1)
        with pytest.raises(TimeoutError):
            bus.recv(FRAME.size)  # nothing more than was sent

    assert [(identifier, data) for identifier, data, _ in received] == frames_of(LOG)
    stamps_ns = [stamp_ns for _, _, stamp_ns in received]
    assert stamps_ns == sorted(stamps_ns)


# Multicast off and a loopback endpoint, as the daemon has it; that kernel also has no IPv6.
ZENOH = """
import json, sys, zenoh
def config(role):
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps("peer" if role == "listen" else "client"))
    config.insert_json5(f"{role}/endpoints", json.dumps([sys.argv[1]]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return config
"""
SUBSCRIBER = (
    ZENOH
    + """
with zenoh.open(config("listen")) as session:
    with session.declare_subscriber("insole/smoke", zenoh.handlers.RingChannel(8)) as subscriber:
        print("ready", flush=True)
        print(subscriber.recv().payload.to_string(), flush=True)
"""
)
PUBLISHER = (
    ZENOH
    + """
with zenoh.open(config("connect")) as session:
    session.put("insole/smoke", "hello from the other process")
"""
)


def test_two_processes_talk_over_zenoh() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with subprocess.Popen(
        [sys.executable, "-c", SUBSCRIBER, endpoint], stdout=subprocess.PIPE, text=True
    ) as subscriber:
        try:
            assert subscriber.stdout is not None
            assert subscriber.stdout.readline() == "ready\n"
            subprocess.run([sys.executable, "-c", PUBLISHER, endpoint], check=True, timeout=30)
            assert subscriber.communicate(timeout=30)[0] == "hello from the other process\n"
        finally:
            subscriber.kill()
