"""Start-up time of `insole --help`, and of a daemon until its first cycle on a busy bus.

    python -m benchmarks.live.start_up

The median of five, of the time and of the CPU time of all threads, which depends less on the load of the machine.
`insole run` is timed from the start of the process to its first `put`. The package's bytecode is written first, as
installing a wheel does; where that folder is read-only, every start compiles the source again.

Takes about half a minute.
"""

from __future__ import annotations

import compileall
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.lib.measured import free_endpoint
from benchmarks.lib.process import CHECKOUT, Child

ROUNDS = 5
INSOLE = Path(sys.executable).with_name("insole")


def help_s() -> float:
    """Seconds that `insole --help` takes."""
    began = time.monotonic()
    subprocess.run([INSOLE, "--help"], check=True, stdout=subprocess.DEVNULL)
    return time.monotonic() - began


def first_publish_s() -> tuple[float, float]:
    """Seconds, and those of CPU time, from the start of `insole run` to its first cycle."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        port = sock.getsockname()[1]
    with tempfile.TemporaryDirectory() as place, Child("lib.feeder", to=f"udp:{port}", seconds=6):
        config = Path(place) / "config.yaml"
        config.write_text(f"format: insole-config/1\nbuses: [opened:can0]\nzenoh:\n  listen: [{free_endpoint()}]\n")
        time.sleep(2.0)  # until it sends
        began_ns = time.time_ns()
        with Child("lib.timed_run", bus=f"udp:{port}", config=config) as daemon:
            time.sleep(2.0)
            report = daemon.end()
            return (report["first_ns"] - began_ns) * 1e-9, report["cpu_s"]


def main() -> None:
    for package in ("insole_daemon", "benchmarks"):
        compileall.compile_dir(CHECKOUT / package, quiet=1)
    help_took, first_took, cpu = [], [], []
    for _ in range(ROUNDS):
        help_took.append(help_s())
        first_s, cpu_s = first_publish_s()
        first_took.append(first_s)
        cpu.append(cpu_s)
    for what, took in (("insole --help", help_took), ("first publish", first_took), ("CPU time of it", cpu)):
        print(f"{what:15} {statistics.median(took):.2f} s  ({min(took):.2f} to {max(took):.2f})")
    print(f"load            {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
