"""Time until a CAN interface is read again that was unplugged and came back under another index.

    python tests/vcan/uml.py -- .venv/bin/python -m benchmarks.faults.reopened

Needs root and a kernel with vcan, which the first part of that line brings. Of the time in the fault matrix's row this
is the daemon's own share: from the end of `ip link set up` to the first frame taken in, while a node sends every 5 ms.

Takes about half a minute, and needs root and vcan.
"""

from __future__ import annotations

import socket
import struct
import subprocess
import threading
import time
from collections.abc import Callable

import numpy as np

from insole_daemon.bus.recovering import RecoveringSource
from insole_daemon.config import Bus

NAME, ROUNDS, GONE_S = "insoler", 8, 1.3
FRAME = struct.pack("=IB3x8s", 0x450, 8, bytes(8))


def ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True)


def send(stop: threading.Event) -> None:
    """A node with a supply of its own, on whatever has the name now."""
    index, sock = 0, None
    while not stop.wait(0.005):
        try:
            if socket.if_nametoindex(NAME) != index:
                index = socket.if_nametoindex(NAME)
                sock = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
                sock.bind((NAME,))
            if sock is not None:
                sock.send(FRAME)
        except OSError:
            pass  # it is gone, or down


def look(source: RecoveringSource, done: Callable[[], bool]) -> float:
    """Read until frames came and `done`; when that was."""
    while True:
        source.wait(0.02)
        source.receive()
        if len(source.drain()) and done():
            return time.monotonic()


def come_back(index: int) -> float:
    """When the interface was up again."""
    ip("link", "add", "dev", NAME, "index", str(index), "type", "vcan")
    ip("link", "set", NAME, "up")
    return time.monotonic()


def main() -> None:
    stop, took_s = threading.Event(), []
    come_back(200)
    source, node = RecoveringSource([Bus("socketcan", NAME)]), threading.Thread(target=send, args=(stop,))
    node.start()
    for number in range(1, ROUNDS + 1):
        look(source, lambda: True)
        ip("link", "del", NAME)
        gone_s = time.monotonic()
        while time.monotonic() < gone_s + GONE_S:
            source.wait(0.02)
            source.receive()
            source.drain()
        up_s: list[float] = []
        adapter = threading.Thread(target=lambda index, at: at.append(come_back(index)), args=(200 + number, up_s))
        adapter.start()
        read_s = look(source, lambda n=number: source.counters.interfaces[NAME].reopened >= n)
        adapter.join()
        took_s.append(read_s - up_s[0])
    stop.set()
    node.join()
    source.close()
    ip("link", "del", NAME)
    print(f"read again after {np.median(took_s):.3f} s (median of {ROUNDS}), {max(took_s):.3f} s at most")


if __name__ == "__main__":
    main()
