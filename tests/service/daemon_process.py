"""The real daemon as a process, fed with `struct can_frame` in UDP datagrams where tests have no CAN in the kernel.

Everything but the address family of one socket is what `insole run` does; tests/vcan runs `insole run` itself.
"""

from __future__ import annotations

import faulthandler
import signal
import socket
import sys
from pathlib import Path

from insole_daemon import config as configs
from insole_daemon.bus.socketcan import SocketCanSource
from insole_daemon.service.daemon import Daemon
from insole_daemon.service.foot import load_feet
from insole_daemon.wire.session import open_daemon_session


def main(config_file: str, port: str) -> None:
    config = configs.load(config_file)
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", int(port)))
    source = SocketCanSource(sock, "can0")
    with open_daemon_session(config.zenoh) as session:
        daemon = Daemon(source, load_feet(config), session, Path(config_file))
        faulthandler.register(signal.SIGUSR1)  # prints where every thread is
        signal.signal(signal.SIGTERM, lambda *_: daemon.stop())
        signal.signal(signal.SIGHUP, lambda *_: daemon.reload())
        daemon.run(lambda: print("ready", flush=True))
    source.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
