"""Time without messages for subscribers after the daemon was killed, with the restart delay of systemd.

    python -m benchmarks.faults.restart [--rounds 5]

Both feet over UDP (tests/service/daemon_process.py: all but the address family is `insole run`); SIGKILL, RestartSec,
start. From the kill to the first cycle that a subscriber in this process gets of the new one.

Takes about half a minute.
"""

from __future__ import annotations

import argparse
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import insole_daemon
from insole_daemon.bus.sink import can_frames
from insole_daemon.config import Config
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.load import Unloaded

CHECKOUT = Path(__file__).parents[2]
UNIT = CHECKOUT / "systemd" / "insole-daemon.service"
BOARDS_S = 2.0  # of frames, made once and played again and again


def main() -> None:
    parser = argparse.ArgumentParser(description="From a SIGKILL to the next cycle at a subscriber.")
    parser.add_argument("--rounds", type=int, default=5)
    rounds = parser.parse_args().rounds
    restart_s = restart_sec()
    with tempfile.TemporaryDirectory() as name:
        endpoint, port = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}", free_port(socket.SOCK_DGRAM)
        config = Path(name, "config.yaml")
        config.write_text(f"format: insole-config/1\nrig: restart\nzenoh:\n  listen: [{endpoint}]\n")
        stop = threading.Event()
        boards = threading.Thread(target=play, args=(port, stop))
        boards.start()
        daemon = start(config, port, name)
        gaps_s = []
        try:
            with insole_daemon.connect(endpoint) as insole:
                wrenches = insole.wrenches("left")
                for _ in range(rounds):
                    until = time.monotonic() + 2
                    before = next(w for w in wrenches if time.monotonic() > until)
                    daemon.kill()
                    killed = time.monotonic()
                    daemon.wait()
                    time.sleep(restart_s)
                    daemon = start(config, port, name)
                    next(w for w in wrenches if w.started_ns != before.started_ns)
                    gaps_s.append(time.monotonic() - killed)
        finally:
            daemon.terminate()
            daemon.wait()
            stop.set()
            boards.join()
    print(f"without cycles for {statistics.median(gaps_s):.2f} s (median of {rounds}; most {max(gaps_s):.2f} s),")
    print(f"RestartSec {restart_s:g} s of it, at a load of {os.getloadavg()[0]:.1f}")


def start(config: Path, port: int, state: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, str(CHECKOUT / "tests" / "service" / "daemon_process.py"), str(config), str(port)]
    environment = {**os.environ, "STATE_DIRECTORY": state}
    daemon = subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, cwd=CHECKOUT)
    assert daemon.stdout is not None
    assert daemon.stdout.readline() == b"ready\n"
    return daemon


def play(port: int, stop: threading.Event) -> None:
    """Frames of both feet at their times, over and over."""
    config = Config()
    layouts = [load_layout(insole) for insole in config.insoles]
    batch = Emulator(config, layouts, Unloaded(layouts)).frames(0, BOARDS_S)
    frames, times_s = [row.tobytes() for row in can_frames(batch)], (batch.t_ns * 1e-9).tolist()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.connect(("127.0.0.1", port))
        began = time.monotonic()
        while not stop.is_set():
            for frame, at_s in zip(frames, times_s, strict=True):
                ahead_s = began + at_s - time.monotonic()
                if ahead_s > 0.001:
                    time.sleep(ahead_s)
                try:
                    sock.send(frame)
                except ConnectionRefusedError:  # nobody listens while the daemon restarts
                    pass
            began += BOARDS_S


def restart_sec() -> float:
    """RestartSec= of the unit, s."""
    (line,) = (line for line in UNIT.read_text().splitlines() if line.startswith("RestartSec="))
    return float(line.removeprefix("RestartSec=").removesuffix("ms")) / 1000


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


if __name__ == "__main__":
    main()
