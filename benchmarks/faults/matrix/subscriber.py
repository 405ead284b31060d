"""A process: subscribes to cycles, health and events, and writes down what it saw and when.

    python -m benchmarks.faults.matrix.subscriber ENDPOINT OUT

Says "subscribed"; ends and writes at the end of stdin.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterable
from pathlib import Path

import msgpack

import insole_daemon
from insole_daemon.wire.messages import Message


def main(endpoint: str, out: str) -> None:
    seen = []

    def listen(messages: Iterable[Message]) -> None:
        for message in messages:
            seen.append((time.monotonic_ns(), message.SCHEMA, message.encode()))

    with insole_daemon.connect(endpoint) as insole:
        streams = insole.raws(), insole.healths(), insole.events()
        threads = [threading.Thread(target=listen, args=(stream,)) for stream in streams]
        for thread in threads:
            thread.start()
        print("subscribed", flush=True)
        sys.stdin.read()
    for thread in threads:
        thread.join()
    Path(out).write_bytes(msgpack.packb(sorted(seen)))


if __name__ == "__main__":
    main(*sys.argv[1:])
