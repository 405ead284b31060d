"""Start-up time of `insole --help`, and of a daemon until its first cycle on a busy bus.

    python -m benchmarks.live.start_up

The median of five. The daemon is timed from the start of the process to its first `put`, without the command line's
imports, which the time of `insole --help` holds: the sum is more than `insole run` needs. The package's bytecode is
written first, as installing a wheel does; where it may not be written, every start compiles the source anew.

Takes about half a minute.
"""

from __future__ import annotations

import compileall
import socket
import statistics
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.lib.process import CHECKOUT, Child

ROUNDS = 5
INSOLE = Path(sys.executable).with_name("insole")


def help_s() -> float:
    """Seconds that `insole --help` takes."""
    began = time.monotonic()
    subprocess.run([INSOLE, "--help"], check=True, stdout=subprocess.DEVNULL)
    return time.monotonic() - began


def first_publish_s() -> float:
    """Seconds from the start of the process to its first cycle."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        port = sock.getsockname()[1]
    with Child("lib.feeder", to=f"udp:{port}", seconds=6):
        time.sleep(2.0)  # until it sends
        began_ns = time.time_ns()
        with Child("lib.timed_daemon", bus=f"udp:{port}") as daemon:
            daemon.said()
            time.sleep(0.5)
            first_ns: int = daemon.end()["first_ns"]
            return (first_ns - began_ns) * 1e-9


def main() -> None:
    for package in ("insole_daemon", "benchmarks"):
        compileall.compile_dir(CHECKOUT / package, quiet=1)
    help_took, first_took = [], []
    for _ in range(ROUNDS):
        help_took.append(help_s())
        first_took.append(first_publish_s())
    help_median, first_median = statistics.median(help_took), statistics.median(first_took)
    print(f"insole --help   {help_median:.2f} s  ({min(help_took):.2f} to {max(help_took):.2f})")
    print(f"first publish   {first_median:.2f} s  ({min(first_took):.2f} to {max(first_took):.2f})")
    print(f"together        {help_median + first_median:.2f} s")


if __name__ == "__main__":
    main()
