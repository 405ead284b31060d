"""A Zenoh router for a lab of many wearers, where zenohd is not installed: docs/many-wearers.md.

python router.py tcp/0.0.0.0:7447
"""

from __future__ import annotations

import signal
import sys
import threading

from insole_daemon.errors import InsoleError
from insole_daemon.wire.session import open_session


def main(*listen: str) -> None:
    """Route until a signal comes."""
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    with open_session("router", listen or ["tcp/127.0.0.1:7447"]):
        print("routing", flush=True)  # noqa: T201
        ended.wait()


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except InsoleError as error:
        sys.exit(f"router: {error}")
