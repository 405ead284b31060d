"""Cost of each part of a cycle with cold caches, as after a sleep, and with warm ones.

    python -m benchmarks.live.cold [--cycles 300] [--both-models]

Takes about 10 s. `--both-models` measures a foot whose calibration has hysteresis, viscoelasticity, lag and delay
beside one without effects, and prints what they add.

Between two cycles the process overwrites more memory than its caches hold and sleeps; then one cycle of one foot goes
through the daemon's own code, from the frames that a socket handed over to the payloads, part by part. Nothing is sent.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.lib import traffic
from insole_daemon.bus.frames import FrameBatch, ReceivedFrames
from insole_daemon.bus.sink import can_frames
from insole_daemon.compiled import kernel
from insole_daemon.physics.effect import Effect, effect
from insole_daemon.service.foot import Foot
from insole_daemon.skin.reader import SkinReader

_CACHE_BYTES = 16 << 20  # more than the caches of one core hold
_SLEEP_S = 0.004
_PERIOD_NS, _SLACK_NS = traffic.PERIOD_NS, 5_000_000
_EFFECTS = (
    effect("hysteresis", r_pa=[3e3, 1e4, 3e4], w=[0.1, 0.08, 0.06]),
    effect("viscoelasticity", a=0.15, tau_s=0.3),
    effect("lag", tau_s=0.02),
    effect("delay", delay_s=0.025),
)


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


def foot_with(effects: Sequence[Effect]) -> Foot:
    """The left foot with the built-in layout, and a calibration that has `effects`."""
    setup = traffic.feet()[0].setup
    return Foot(replace(setup, calibration=replace(setup.calibration, effects=tuple(effects))))


def measure(n: int, cold: bool, effects: Sequence[Effect] = ()) -> Parts:
    """`n` cycles of the left foot, walking."""
    feet = [foot_with(effects)]
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
    parser.add_argument("--both-models", action="store_true", help="measure what effects in the calibration add")
    options = parser.parse_args()
    sums = []
    for effects in ((), _EFFECTS) if options.both_models else ((),):
        cold, warm = measure(options.cycles, True, effects), measure(options.cycles, False, effects)
        print(f"\n| {'both models' if effects else 'one model'} | cold | warm |\n|---|---|---|")
        for part, us in cold.us.items():
            print(f"| {part} | {mean(us):.0f} µs | {mean(warm.us[part]):.0f} µs |")
        sums.append([sum(map(mean, parts.us.values())) for parts in (cold, warm)])
        print(f"| sum | {sums[-1][0]:.0f} µs | {sums[-1][1]:.0f} µs |")
    if options.both_models:
        print(f"\nboth models: + {sums[1][0] - sums[0][0]:.0f} µs cold, + {sums[1][1] - sums[0][1]:.0f} µs warm")


if __name__ == "__main__":
    main()
