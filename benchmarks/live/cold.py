"""Cost of each part of a cycle with cold caches, as after a sleep, and with warm ones.

    python -m benchmarks.live.cold [--cycles 300]

Takes about 10 s.

Between two cycles the process overwrites more memory than its caches hold and sleeps; then one cycle of one foot goes
through the daemon's own code, from the frames that a socket handed over to the payloads, part by part. Nothing is sent.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.lib import traffic
from insole_daemon.bus.frames import FrameBatch, ReceivedFrames
from insole_daemon.bus.sink import can_frames
from insole_daemon.compiled import kernel
from insole_daemon.service.foot import Foot
from insole_daemon.skin.reader import SkinReader

_CACHE_BYTES = 16 << 20  # more than the caches of one core hold
_SLEEP_S = 0.004
_PERIOD_NS, _SLACK_NS = traffic.PERIOD_NS, 5_000_000


class Parts:
    """Times of the parts of one cycle after another."""

    def __init__(self) -> None:
        self.us: dict[str, list[float]] = {}

    def time(self, part: str, work: Callable[[], Any]) -> Any:
        """The result of `work`, whose time is that of `part`."""
        began_ns = time.perf_counter_ns()
        result = work()
        self.us.setdefault(part, []).append((time.perf_counter_ns() - began_ns) * 1e-3)
        return result


def cycle(parts: Parts, reader: SkinReader, feet: list[Foot], batch: FrameBatch) -> None:
    """All that the daemon computes of the frames of one cycle of one foot."""
    closed = parts.time("frames to cycle", lambda: reader.closed_cycles(batch))
    for foot, of_foot in zip(feet, closed, strict=True):
        for closed_cycle in of_foot:
            parts.time("cycle to payloads", lambda: foot.payloads(closed_cycle))  # noqa: B023
            parts.time("fault watch", foot.fault_events)


def received(batch: FrameBatch) -> FrameBatch:
    """Return `batch` as a socket hands it over: one block, where there is the kernel."""
    if kernel is None:
        return batch
    return ReceivedFrames(b"".join((batch.t_ns, batch.t_mono_ns, can_frames(batch), batch.interface)))


def mean(us: list[float]) -> float:
    """Without the slowest twentieth, in which something else ran; cycles in which a part does nothing count."""
    return statistics.fmean(sorted(us)[: -(len(us) // 20) or None])


def measure(n: int, cold: bool) -> Parts:
    """`n` cycles of the left foot, walking."""
    feet = traffic.feet()[:1]
    batch = traffic.frames(0.02 * (n + 60))
    batch = batch[batch.can_id < 0x480]
    reader = SkinReader([foot.layout for foot in feet], _PERIOD_NS, _SLACK_NS)
    size = 2 * feet[0].n_triangles
    cache = np.zeros(_CACHE_BYTES, np.uint8)
    parts = Parts()
    for number in range(50, n + 50):
        if number == 50:
            cycle(Parts(), reader, feet, received(batch[slice(0, 50 * size)]))
        frames = received(batch[slice(number * size, (number + 1) * size)])
        if cold:
            cache += 1
            time.sleep(_SLEEP_S)
        cycle(parts, reader, feet, frames)
    return parts


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cycles", type=int, default=300)
    options = parser.parse_args()
    cold, warm = measure(options.cycles, True), measure(options.cycles, False)
    print("| part | cold | warm |\n|---|---|---|")
    for part, us in cold.us.items():
        print(f"| {part} | {mean(us):.0f} µs | {mean(warm.us[part]):.0f} µs |")
    print(f"| sum | {sum(map(mean, cold.us.values())):.0f} µs | {sum(map(mean, warm.us.values())):.0f} µs |")


if __name__ == "__main__":
    main()
