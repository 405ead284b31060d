"""Run the bus side of `insole record` as a process, fed with `struct can_frame` in UDP datagrams; reference lines on
stdin.

Only the address family of one socket differs from `insole record`; tests/vcan runs the command itself. A fifth argument
selects guidance by a protocol of seconds instead of minutes.
"""

from __future__ import annotations

import signal
import socket
import sys
import threading
from pathlib import Path

from insole_daemon import config as configs
from insole_daemon.bus.socketcan import SocketCanSource
from insole_daemon.cli.record import ProgressPrinter, insoles_of
from insole_daemon.recording.coverage import Protocol
from insole_daemon.recording.guide import Guide
from insole_daemon.recording.instrument import Instrument
from insole_daemon.recording.live import LiveRecorder
from insole_daemon.recording.recorder import Session, read_lines, with_time

SHORT = Protocol(rest_s=0.8, slow_s=1.5, ratio=2.0, hold_s=1.5, recovery_s=1.5, loops=2, steps=0)


def main(out: str, config_file: str, port: str, rotate_bytes: str, guided: str = "") -> None:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", int(port)))
    source = SocketCanSource(sock, "can0")
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    insoles = insoles_of(configs.load(config_file))
    recorder = LiveRecorder(Path(out), "chamber", insoles, 1, source.interfaces, int(rotate_bytes) or None)
    instrument = Instrument("left", "chamber")
    session = Session(recorder, stop, instruments=[instrument])
    if guided:
        progress_lines = ProgressPrinter(Path(out), None)
        session.report_progress, session.report_change = progress_lines, progress_lines.note
        session.guide = Guide(insoles, "chamber", SHORT)
    session.merged_queue.read(instrument, with_time(read_lines(0)))
    print("ready", flush=True)
    progress = session.from_bus(source)
    if guided:
        progress_lines.end(progress)
    recorder.close()
    source.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
