"""`insole demo` as a process without a terminal, and when a part of it dies."""

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

from tests.ports import free_port

INSOLE = Path(sys.executable).with_name("insole")
DIES = """
import sys
from insole_daemon.cli import main
from insole_daemon.service.daemon import Daemon

def die(*args):
    raise OSError("the wire was cut")

Daemon.{method} = die if "{method}" == "_report" else lambda self, ready: die()
sys.argv = ["insole", "demo", "--listen", "{endpoint}"]
main()
"""


def test_it_ends_by_itself_and_has_shown_both_feet(endpoint):
    command = [INSOLE, "demo", "--seconds", "2", "--listen", endpoint]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for foot in ("left", "right"):
        assert re.search(rf"^{foot} +f_z +(-?\d+|–) N  m_x .* lost \d+$", done.stdout, re.MULTILINE), done.stdout
        assert re.search(rf"^{foot}: [1-9]\d* cycles seen, \d+ lost$", done.stderr, re.MULTILINE)


@pytest.mark.parametrize("method", ["run", "_report"], ids=["at once", "after a second"])
def test_it_ends_with_the_error_of_its_daemon(method, endpoint):
    program = DIES.format(method=method, endpoint=endpoint)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 3
    assert "insole: the demo's daemon stopped: the wire was cut." in done.stderr
    assert "Traceback" not in done.stderr


def test_it_shows_itself_in_a_browser(endpoint):
    port = free_port()
    command = [INSOLE, "demo", "--seconds", "3", "--view", "--port", str(port), "--listen", endpoint]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "BROWSER": "true"})
    assert done.returncode == 0, done.stderr
    assert f"the page is on http://127.0.0.1:{port}/" in done.stdout
    with socket.socket() as sock:
        assert sock.connect_ex(("127.0.0.1", port)) != 0, "the page has ended with the demo"


def test_ctrl_c_as_soon_as_the_page_is_served_ends_the_demo_with_status_0(endpoint):
    port = free_port()
    with subprocess.Popen(
        [INSOLE, "demo", "--view", "--port", str(port), "--listen", endpoint],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        env={**os.environ, "BROWSER": "true"},
    ) as demo:  # fmt: skip
        while demo.poll() is None:
            with socket.socket() as sock:
                if sock.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.01)
        demo.send_signal(signal.SIGINT)
        printed, _ = demo.communicate()
    assert demo.returncode == 0, printed
