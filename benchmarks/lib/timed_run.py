"""`insole run` as a person starts it, on the benchmark's bus; it reports when it published its first cycle.

python -m benchmarks.lib.timed_run --bus udp:PORT --config FILE
"""

from __future__ import annotations

import argparse
import json
import socket
import sys
import time
from collections.abc import Sequence

from insole_daemon import cli
from insole_daemon.bus import link
from insole_daemon.bus.socketcan import SocketCanSource
from insole_daemon.wire.messages import Message, Wrench
from insole_daemon.wire.publisher import FootPublisher


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bus", required=True, help="udp:PORT")
    parser.add_argument("--config", required=True)
    options = parser.parse_args()
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", int(options.bus.partition(":")[2])))
    sock.setblocking(False)
    source = SocketCanSource(sock, "can0")
    link.open_bus = lambda bus: source
    put = FootPublisher.put
    first: dict[str, float] = {}

    def timed(self: FootPublisher, payloads: Sequence[tuple[type[Message], bytes]]) -> None:
        put(self, payloads)
        if payloads[-1][0] is Wrench and not first:
            first.update(first_ns=time.time_ns(), cpu_s=time.process_time())

    FootPublisher.put = timed  # type: ignore[method-assign]
    sys.argv = ["insole", "run", "--config", options.config]
    try:
        cli.main()
    finally:
        print(json.dumps(first), flush=True)


if __name__ == "__main__":
    main()
