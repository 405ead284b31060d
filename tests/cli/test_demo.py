"""`insole demo` as a process without a terminal, and when a part of it dies. Its port is always the same."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from insole_daemon.config import DEFAULT_ENDPOINT

INSOLE = Path(sys.executable).with_name("insole")
DIES = """
import sys
from insole_daemon.cli import main
from insole_daemon.service.daemon import Daemon

def die(*args):
    raise OSError("the wire was cut")

Daemon.{method} = die if "{method}" == "_report" else lambda self, ready: die()
sys.argv = ["insole", "demo"]
main()
"""


@pytest.fixture(autouse=True)
def _port():
    port = int(DEFAULT_ENDPOINT.rpartition(":")[2])
    with socket.socket() as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as Zenoh does: what has just ended is no obstacle
        try:
            sock.bind(("127.0.0.1", port))
        except OSError as error:
            pytest.skip(f"port {port}, on which the demo always publishes, is taken: {error}")


def test_it_ends_by_itself_and_has_shown_both_feet():
    began = time.monotonic()
    done = subprocess.run([INSOLE, "demo", "--seconds", "2"], capture_output=True, text=True, timeout=30)
    assert done.returncode == 0, done.stderr
    assert time.monotonic() - began < 15
    for foot in ("left", "right"):
        assert re.search(rf"^{foot} +f_z +(-?\d+|–) N  m_x .* lost \d+$", done.stdout, re.MULTILINE), done.stdout
        assert re.search(rf"^{foot}: [1-9]\d* cycles seen, \d+ lost$", done.stderr, re.MULTILINE)


@pytest.mark.parametrize("method", ["run", "_report"], ids=["at once", "after a second"])
def test_it_ends_with_the_error_of_its_daemon(method):
    done = subprocess.run(
        [sys.executable, "-c", DIES.format(method=method)], capture_output=True, text=True, timeout=30
    )
    assert done.returncode == 3
    assert "insole: the demo's daemon stopped: the wire was cut." in done.stderr
    assert "Traceback" not in done.stderr


def test_it_shows_itself_in_a_browser():
    with socket.socket() as sock:
        if sock.connect_ex(("127.0.0.1", 8080)) == 0:
            pytest.skip("port 8080, on which the page is served by default, is taken")
    done = subprocess.run(
        [INSOLE, "demo", "--seconds", "3", "--view"], capture_output=True, text=True, timeout=60,
        env={**os.environ, "BROWSER": "true"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "the page is on http://127.0.0.1:8080/" in done.stdout
    with socket.socket() as sock:
        assert sock.connect_ex(("127.0.0.1", 8080)) != 0, "the page has ended with the demo"


def test_ctrl_c_as_soon_as_the_page_is_served_ends_the_demo_with_status_0():
    with socket.socket() as sock:
        if sock.connect_ex(("127.0.0.1", 8080)) == 0:
            pytest.skip("port 8080, on which the page is served by default, is taken")
    with subprocess.Popen(
        [INSOLE, "demo", "--view"], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        text=True, env={**os.environ, "BROWSER": "true"},
    ) as demo:  # fmt: skip
        while demo.poll() is None:
            with socket.socket() as sock:
                if sock.connect_ex(("127.0.0.1", 8080)) == 0:
                    break
            time.sleep(0.01)
        demo.send_signal(signal.SIGINT)
        printed, _ = demo.communicate(timeout=30)
    assert demo.returncode == 0, printed
