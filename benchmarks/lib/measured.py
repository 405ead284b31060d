"""What the three programs that are compared have in common: their bus, their keys, and what is measured of them."""

from __future__ import annotations

import argparse
import json
import os
import resource
import signal
import socket
import time
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.lib import process
from insole_daemon.bus.source import sleep_precisely

_RSS_EVERY_NS = 1_000_000_000
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True, slots=True)
class Options:
    """What the driver tells a measured program."""

    bus: str
    endpoint: str
    warm_up: float
    seconds: float
    cpu: int | None
    extra: dict[str, Any]


def options(description: str, add: Callable[[argparse.ArgumentParser], None] = lambda _: None) -> Options:
    """From the command line; the process then runs on its CPU."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--bus", default="udp", help="udp, udp:PORT, or a CAN interface such as vcan0")
    parser.add_argument("--endpoint", default="", help="of Zenoh; left out: a free port")
    parser.add_argument("--warm-up", type=float, default=2.0, help="seconds before anything is measured")
    parser.add_argument("--seconds", type=float, default=10.0, help="that are measured")
    parser.add_argument("--cpu", type=int, help="the only CPU to run on")
    add(parser)
    values = vars(parser.parse_args())
    process.settle(values["cpu"])
    sleep_precisely()  # as the daemon does
    own = {name: values.pop(name) for name in ("bus", "endpoint", "warm_up", "seconds", "cpu")}
    own["endpoint"] = own["endpoint"] or free_endpoint()
    return Options(**own, extra=values)


def free_endpoint() -> str:
    """A loopback port that nobody uses."""
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{sock.getsockname()[1]}"


def open_udp(port: int = 0) -> tuple[socket.socket, str]:
    """A loopback socket whose datagrams are `struct can_frame`, and how the feeder names it."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", port))
    return sock, f"udp:{sock.getsockname()[1]}"


def open_bus(bus: str) -> tuple[socket.socket, str]:
    """A socket on `bus`, and how the feeder names it."""
    kind, _, port = bus.partition(":")
    if kind == "udp":
        return open_udp(int(port or 0))
    sock = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    sock.bind((bus,))
    return sock, bus


def on_end(stop: Callable[[], object]) -> None:
    """Call `stop` when the driver says that it is over."""
    signal.signal(signal.SIGTERM, lambda *_: stop())


def ready(feeds: list[str], endpoint: str) -> None:
    """Tell the driver where frames are awaited and cycles are put."""
    print(json.dumps({"feeds": feeds, "endpoint": endpoint}), flush=True)


class Recorder:
    """CPU, latency and memory of this process between `warm_up` and `warm_up + seconds` after its first cycle."""

    def __init__(self, options: Options) -> None:
        self.published: dict[str, int] = {}
        self._warm_up_ns, self._window_ns = round(options.warm_up * 1e9), round(options.seconds * 1e9)
        self._first_ns = self._opens_ns = self._closes_ns = self._next_rss_ns = 0
        self._latency_ns = array("q")
        self._rss_mb: list[float] = []
        self._began: tuple[int, resource.struct_rusage] | None = None
        self._ended: tuple[int, resource.struct_rusage] | None = None

    def cycle(self, foot: str, newest_t_ns: int) -> None:
        """The last message of a cycle, whose newest frame the kernel stamped `newest_t_ns`, has just been put."""
        now_ns = time.time_ns()
        self.published[foot] = self.published.get(foot, 0) + 1
        if not self._first_ns:
            self._first_ns = now_ns
            self._opens_ns = now_ns + self._warm_up_ns
            self._closes_ns = self._opens_ns + self._window_ns
        if now_ns < self._opens_ns or self._ended:
            return
        if self._began is None:
            self._began = now_ns, resource.getrusage(resource.RUSAGE_SELF)
        self._latency_ns.append(now_ns - newest_t_ns)
        if now_ns >= self._next_rss_ns:
            self._next_rss_ns = now_ns + _RSS_EVERY_NS
            self._rss_mb.append(rss_mb())
        if now_ns >= self._closes_ns:
            self._ended = now_ns, resource.getrusage(resource.RUSAGE_SELF)

    def report(self, frames: int, **more: Any) -> None:
        """Print what was measured."""
        figures: dict[str, Any] = {"frames": frames, "published": self.published, "first_ns": self._first_ns, **more}
        if self._began and self._ended:
            (begin_ns, before), (end_ns, after) = self._began, self._ended
            elapsed_s = (end_ns - begin_ns) * 1e-9
            cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            ms = np.frombuffer(self._latency_ns, np.int64) * 1e-6
            p50, p99, worst = np.percentile(ms, [50, 99, 100]).tolist()
            figures |= {
                "cpu_percent": 100 * cpu_s / elapsed_s,
                "latency_ms_p50": p50,
                "latency_ms_p99": p99,
                "latency_ms_max": worst,
                "cycles": len(ms),
                "wake_ups_per_cycle": (after.ru_nvcsw - before.ru_nvcsw) / len(ms),
                "rss_mb": self._rss_mb,
            }
        print(json.dumps(figures), flush=True)


def rss_mb() -> float:
    """Resident memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE_BYTES / 1e6
