"""What stands on a terminal while a command computes, and what goes to a file instead."""

from __future__ import annotations

import os
import pty
import re
import socket
import subprocess
import sys

WORK = """
import time
from insole_daemon.cli.progress import show_work
with show_work("fitting [left] foot", (1, 3)) as work:
    work("90 of [taxels] kept")
    time.sleep(0.5)
    work("both fitted")  # a quarter of the work is done
    time.sleep(0.5)
"""


def test_a_terminal_shows_the_work_and_the_time_until_it_is_done() -> None:
    terminal, end = pty.openpty()
    done = subprocess.Popen([sys.executable, "-c", WORK], stderr=end, env=os.environ | {"TERM": "xterm"})
    os.close(end)
    shown = b""
    try:
        while part := os.read(terminal, 4096):
            shown += part
    except OSError:  # so a terminal ends whose program has
        pass
    os.close(terminal)
    assert done.wait() == 0
    text = re.sub(r"\x1b\[\d+m", "", shown.decode())
    assert "insole: 90 of [taxels] kept" in text
    assert re.search(r"fitting \[left\] foot ━+ 0:00:00", text)
    assert re.search(r"foot \S+ 0:00:0\d 0:0[12] left", text), "half a second was a quarter of it"
    assert text.rindex("fitting") < text.rindex("\x1b[2K"), "the line is taken away at the end"


def test_a_file_has_the_lines_alone() -> None:
    done = subprocess.run([sys.executable, "-c", WORK], capture_output=True, text=True, check=True)
    assert done.stderr == "insole: 90 of [taxels] kept\ninsole: both fitted\n"


def test_a_line_and_its_end_are_written_together() -> None:
    reading, writing = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)  # one packet for one write
    with reading, writing:
        unbuffered = os.environ | {"PYTHONUNBUFFERED": "1"}
        subprocess.run([sys.executable, "-c", WORK], stderr=writing, check=True, env=unbuffered)
        writing.close()
        assert list(iter(lambda: reading.recv(4096), b"")) == [
            b"insole: 90 of [taxels] kept\n",
            b"insole: both fitted\n",
        ]
