"""A program that reads everything a daemon publishes, in another process, and counts what did not arrive."""

from __future__ import annotations

import argparse
import json
import signal
import threading
import time
from dataclasses import dataclass

import msgpack
import zenoh

from benchmarks.lib import process
from insole_daemon.wire.session import open_session

_CYCLE_KEYS = ("raw", "pressure", "wrench")


@dataclass(slots=True)
class Stream:
    """What arrived on one key."""

    received: int = 0
    gaps: int = 0  # sequence numbers that did not come; the floor's bytes never change and have none
    last_seq: int | None = None
    first_ns: int = 0
    last_ns: int = 0

    def take(self, payload: bytes) -> None:
        """Count a message."""
        self.last_ns = time.monotonic_ns()
        if not self.received:
            self.first_ns = self.last_ns
        self.received += 1
        seq: int = msgpack.unpackb(payload)["seq"]
        expected = 0 if self.last_seq is None else self.last_seq + 1  # it is there before the first cycle
        self.gaps += max(0, seq - expected)
        self.last_seq = seq

    def rate_hz(self) -> float:
        """Over all that arrived."""
        return (self.received - 1) / max(1, self.last_ns - self.first_ns) * 1e9


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--endpoint", required=True)
    parser.add_argument("--cpu", type=int, help="the only CPU to run on")
    options = parser.parse_args()
    process.settle(options.cpu)
    streams: dict[str, Stream] = {}
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())

    def take(sample: zenoh.Sample) -> None:
        _, _, foot, what = str(sample.key_expr).split("/")
        if what in _CYCLE_KEYS:
            streams.setdefault(f"{foot}/{what}", Stream()).take(sample.payload.to_bytes())

    with open_session("client", connect=[options.endpoint]) as session:
        subscriber = session.declare_subscriber("insole/**", take)
        print(json.dumps({"ready": True}), flush=True)
        ended.wait()
        subscriber.undeclare()
    print(
        json.dumps(
            {
                name: {"received": stream.received, "gaps": stream.gaps, "rate_hz": stream.rate_hz()}
                for name, stream in sorted(streams.items())
            }
        )
    )


if __name__ == "__main__":
    main()
