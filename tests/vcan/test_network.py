"""A daemon and a subscriber on two hosts, with a cable between that is pulled."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.vcan

INSOLE = Path(sys.executable).with_name("insole")
NEAR, FAR = "10.9.0.1", "10.9.0.2"
CUT_S = 7.0  # TCP by itself then waits for another six seconds before it tries again
BACK_S = 3.0  # it takes half a second; what else this kernel's one processor does may come first
SUBSCRIBER = """
import sys, time, insole_daemon
with insole_daemon.connect(sys.argv[1]) as insole:
    for _ in insole.wrenches("left"):
        print(time.monotonic(), flush=True)
"""


def ip(*words: str) -> None:
    subprocess.run(["ip", *" ".join(words).split()], check=True, capture_output=True)


@pytest.fixture
def cable() -> Iterator[str]:
    """Another network name space, and the name of the near end of the cable to it."""
    ip("netns add far")
    try:
        ip("link add near type veth peer name away")
        ip("link set away netns far")
        ip(f"addr add {NEAR}/24 dev near")
        ip("link set near up")
        ip(f"-n far addr add {FAR}/24 dev away")
        ip("-n far link set away up")
        yield "near"
    finally:
        ip("netns del far")  # and the cable with it


@pytest.mark.timeout(120)
def test_a_cable_that_was_out(cable: str, vcan: str, tmp_path: Path) -> None:
    endpoint = f"tcp/{NEAR}:7447"
    boards = ", ".join(f"{{address: {address}, interface: {vcan}}}" for address in (5, 6, 7))
    (tmp_path / "config.yaml").write_text(
        f"format: insole-config/1\nzenoh: {{listen: [{endpoint}]}}\nbuses: [socketcan:{vcan}]\n"
        f"insoles: [{{foot: left, boards: [{boards}]}}]\n"
    )
    daemon = subprocess.Popen([INSOLE, "run", "--config", tmp_path / "config.yaml"], stderr=subprocess.PIPE, text=True)
    subscriber = None
    try:
        assert daemon.stderr is not None
        while "reading" not in daemon.stderr.readline():
            assert daemon.poll() is None
        subprocess.run(
            ["cansend", vcan, "450#40F0F0F0F0F0F0F0"], check=True
        )  # from the first frame on there are cycles, be they repeats
        subscriber = subprocess.Popen(
            ["ip", "netns", "exec", "far", sys.executable, "-c", SUBSCRIBER, endpoint],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert subscriber.stdout is not None
        for _ in range(50):
            assert subscriber.stdout.readline()
        ip(f"link set {cable} down")
        time.sleep(CUT_S)
        ip(f"link set {cable} up")
        back = time.monotonic()
        while (received_s := float(subscriber.stdout.readline())) < back:
            pass
        assert received_s - back < BACK_S
    finally:
        for process in (subscriber, daemon):
            if process is not None:
                process.terminate()
                process.communicate(timeout=30)
