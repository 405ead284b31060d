"""Leaks, slow-down and lost frames of the live path in a simulated day with random faults.

    python -m benchmarks.endurance.soak              # 24 hours, at up to 20 times real time: 72 minutes or more
    python -m benchmarks.endurance.soak --hours 0.5  # less of it; SIGTERM ends it sooner, with the report so far

Frames, cycles, health and clock steps use injected time. Zenoh, the subscriber (a separate process) and the attempts to
reopen a lost interface run at real speed. On the receiving side only the system call `recvmmsg` is replaced.

The kind of every frame is known, because the benchmark made it. At the end every frame must be counted, as used or as
refused for its reason.

Latency is real time, from the arrival of the frames in the process to the end of the last `put` of their cycle. Frames
that waited while the process was stopped (two of the faults) come as one batch of up to 400 cycles, all of which are
published, so the latency of a cycle includes the work on all cycles before it. Those cycles, a hundredth of all, have
figures of their own; otherwise the 99th percentile of an hour would depend on its number of stops.

Takes about 94 minutes.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import signal
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.endurance.soak_bus import Clock, accounts
from benchmarks.endurance.soak_faults import Day, FaultyBus, loops
from benchmarks.lib import measured
from benchmarks.lib.process import Child
from insole_daemon import config as configs
from insole_daemon.bus.frames import FrameBatch
from insole_daemon.service.daemon import Daemon
from insole_daemon.service.foot import load_feet
from insole_daemon.wire.messages import Health, Message, Wrench
from insole_daemon.wire.publisher import FootPublisher
from insole_daemon.wire.session import open_session

HOUR_NS = 3_600_000_000_000
SPEED = 20.0
_BINS_PER_DECADE, _DECADES = 400, 7  # of latency from 1 µs on: half a per cent each
_CONFIG = "format: insole-config/1\nrig: bench\n"


@dataclass(frozen=True, slots=True)
class Census:
    """What the process has."""

    rss_mb: float
    threads: int
    descriptors: int

    @classmethod
    def take(cls) -> Census:
        gc.collect()
        return cls(measured.rss_mb(), len(os.listdir("/proc/self/task")), len(os.listdir("/proc/self/fd")))


class Latencies:
    """How long cycles took, in memory that does not grow."""

    def __init__(self) -> None:
        self._bins = np.zeros(_BINS_PER_DECADE * _DECADES, np.int64)

    def add(self, ns: int) -> None:
        self._bins[min(len(self._bins) - 1, int(np.log10(max(ns, 1000) * 1e-3) * _BINS_PER_DECADE))] += 1

    def __len__(self) -> int:
        return int(self._bins.sum())

    def ms(self, percent: float) -> float:
        """The percentile, at the upper edge of its bin."""
        reached = np.searchsorted(np.cumsum(self._bins), percent / 100 * max(1, self._bins.sum()))
        return float(10 ** ((reached + 1) / _BINS_PER_DECADE) * 1e-3)

    def __str__(self) -> str:
        return f"p50 {self.ms(50):.3f} p99 {self.ms(99):.3f} ms"


@dataclass(frozen=True, slots=True)
class Hour:
    """How long its cycles took."""

    wall: Latencies = field(default_factory=Latencies)
    cpu: Latencies = field(default_factory=Latencies)  # of the daemon's thread
    caught_up: Latencies = field(default_factory=Latencies)  # by the clock, those that had waited for a stop's end


class Soak(FaultyBus):
    """The bus of the day, with a stopwatch at the hand-over of frames."""

    handed_over_ns = handed_over_cpu_ns = 0
    after_stop = False  # what was handed over last had waited for the end of a stop
    _stops = 0

    def drain(self) -> FrameBatch:
        self.after_stop, self._stops = self._clock.stops > self._stops, self._clock.stops
        self.handed_over_ns, self.handed_over_cpu_ns = time.perf_counter_ns(), time.thread_time_ns()
        return super().drain()


class Watch:
    """What is measured hour by hour, from inside the publishers' `publish`."""

    def __init__(self, bus: Soak, clock: Clock, hours: float) -> None:
        self.health: dict[str, Health] = {}
        self.published: dict[str, int] = {}
        self.rows: list[tuple[Census, Hour]] = []
        self._bus, self._clock = bus, clock
        self._start_ns, self._end_ns = clock.monotonic_ns(), clock.monotonic_ns() + round(hours * HOUR_NS)
        self._hour = Hour()
        self._hour_ns, self._hour_real = self._start_ns + HOUR_NS, time.monotonic()
        self.start: Census | None = None
        put = FootPublisher.put

        def timed(publisher: FootPublisher, payloads: Sequence[tuple[type[Message], bytes]]) -> None:
            put(publisher, payloads)
            for kind, payload in payloads:
                if kind is Wrench:
                    self._cycle(Wrench.decode(payload))
                elif kind is Health:
                    self._second(Health.decode(payload))

        FootPublisher.put = timed  # type: ignore[method-assign]

    def _cycle(self, wrench: Wrench) -> None:
        self.published[wrench.foot] = self.published.get(wrench.foot, 0) + 1
        if wrench.repeated:
            return
        wall_ns = time.perf_counter_ns() - self._bus.handed_over_ns
        if self._bus.after_stop:
            self._hour.caught_up.add(wall_ns)
        else:
            self._hour.wall.add(wall_ns)
            self._hour.cpu.add(time.thread_time_ns() - self._bus.handed_over_cpu_ns)

    def _second(self, health: Health) -> None:
        self.health[health.foot] = health
        now_ns = self._clock.monotonic_ns()
        if self.start is None:
            self.start = Census.take()
        if now_ns >= self._end_ns:
            assert self._bus.daemon is not None
            self._bus.daemon.stop()
        if now_ns >= min(self._hour_ns, self._end_ns) and health.foot == "right":
            self.rows.append((Census.take(), self._hour))
            real_s = time.monotonic() - self._hour_real
            self._say(len(self.rows), (HOUR_NS - max(0, self._hour_ns - self._end_ns)) * 1e-9 / real_s)
            self._hour = Hour()
            self._hour_ns, self._hour_real = self._hour_ns + HOUR_NS, time.monotonic()

    def end(self) -> None:
        """Of less than an hour, what there is."""
        if not self.rows:
            self.rows.append((Census.take(), self._hour))

    def _say(self, number: int, speed: float) -> None:
        census, hour = self.rows[-1]
        print(
            f"hour {number:2}: {census.rss_mb:6.2f} MB  {census.threads} threads  {census.descriptors} descriptors  "
            f"latency {hour.wall}  CPU {hour.cpu}  of {len(hour.caught_up)} cycles after stops {hour.caught_up}  "
            f"at {speed:.1f} × real time, load {os.getloadavg()[0]:.1f}",
            flush=True,
        )


def account(bus: Soak, daemon: Daemon) -> int:
    """Print where every frame is; how many are not accounted for."""
    rows = accounts(bus, daemon)
    print("\n| frames | put on the bus | counted by the daemon |\n|---|---|---|")
    for name, sent, counted in rows:
        print(f"| {name} | {sent} | {counted} |")
    print(f"\nwhile the interface was down {bus.unread} more were sent, which nobody can receive")
    return sum(abs(sent - counted) for _, sent, counted in rows)


def report(bus: Soak, daemon: Daemon, watch: Watch, received: dict[str, dict[str, float]]) -> None:
    unaccounted = account(bus, daemon)
    cycles = {foot: health.cycles for foot, health in watch.health.items()}
    print(f"\nwhat happened: {json.dumps(bus.day.happened)}")
    print(f"counters of the last health: {json.dumps({'cycles': cycles, 'bus': asdict(bus.counters)})}")
    for foot, published in watch.published.items():
        streams = {key: stream for key, stream in received.items() if key.startswith(foot)}
        is_complete = {key: stream["received"] + stream["gaps"] == published for key, stream in streams.items()}
        lost = {key: stream["gaps"] for key, stream in streams.items()}
        print(f"{foot}: {published} cycles published; at the subscriber all accounted for: {is_complete}, lost: {lost}")
    assert watch.start is not None
    first, last = watch.rows[0], watch.rows[-1]
    print(f"at the start {watch.start}\nafter the first hour {first[0]}\nat the end {last[0]}")
    ratios = [getattr(last[1], what).ms(99) / getattr(first[1], what).ms(99) for what in ("wall", "cpu")]
    print(f"unaccounted frames: {unaccounted} (wanted 0)")
    print(f"memory after the first hour: {last[0].rss_mb - first[0].rss_mb:+.2f} MB (wanted at most +5)")
    print(f"p99 latency, last hour against the first: {ratios[0]:.2f} ×, of CPU {ratios[1]:.2f} × (wanted at most 1.2)")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=24.0, help="simulated")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    endpoint = measured.free_endpoint()
    with tempfile.TemporaryDirectory() as folder:
        config_file = Path(folder, "config.yaml")
        config_file.write_text(_CONFIG)
        os.environ["STATE_DIRECTORY"] = folder
        clock = Clock(SPEED)
        bus = Soak(clock, config_file, Day(options.seed, loops(options.seed)))
        clock.inject()
        with (
            open_session("peer", [endpoint]) as session,
            Child("lib.subscriber", endpoint=endpoint) as child,
        ):
            child.report()
            daemon = bus.daemon = Daemon(bus, load_feet(configs.load(config_file)), session, config_file)
            watch = Watch(bus, clock, options.hours)
            signal.signal(signal.SIGTERM, lambda *_: daemon.stop())
            time.sleep(0.5)  # until the subscription is there
            daemon.run()
            watch.end()
            time.sleep(1.0)
            received = child.end()
        report(bus, daemon, watch, received)
        bus.close()


if __name__ == "__main__":
    main()
