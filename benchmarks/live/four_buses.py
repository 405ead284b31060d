"""Lost frames with four saturated buses of 1 Mbit/s into one daemon on one core.

    python -m benchmarks.live.four_buses [--seconds 60]

Each bus carries 8 700 frames/s, more than fit on it: the feet are on the first two, and all the rest is skin traffic
of boards that nobody configured, which no kernel filter would keep from the daemon.

Takes about 70 seconds.
"""

from __future__ import annotations

import argparse
import json
import time

import numpy as np

from benchmarks.lib import process, traffic
from benchmarks.lib.feeder import connect, play
from benchmarks.lib.process import Child
from insole_daemon.skin.identifiers import CLASS_SKIN

BUSES = 4
FRAMES_PER_S = 8_700
_UNCONFIGURED_BOARD = 1


def saturated(seed: int) -> tuple[traffic.Loop, list[int]]:
    """The loop of both feet with what fills four buses up to FRAMES_PER_S, and the bus of every frame."""
    feet = traffic.loop(seed)
    of_right_foot = feet.rows.view(np.uint32)[:, 0] >= 0x480
    rows, t_ns, which = [feet.rows], [feet.t_ns], [of_right_foot.astype(np.int64)]
    for bus in range(BUSES):
        n = round(FRAMES_PER_S * feet.length_ns * 1e-9) - int((which[0] == bus).sum())
        filler = np.zeros((n, 16), np.uint8)
        filler.view(np.uint32)[:, 0] = CLASS_SKIN << 8 | _UNCONFIGURED_BOARD << 4 | np.arange(n) % 16
        filler[:, 4] = 8
        filler[:, 8:] = np.random.default_rng([seed, bus]).integers(0, 256, (n, 8))
        rows.append(filler)
        t_ns.append(np.arange(n) * feet.length_ns // n)
        which.append(np.full(n, bus))
    order = np.argsort(np.concatenate(t_ns), kind="stable")
    loop = traffic.Loop(np.concatenate(rows)[order], np.concatenate(t_ns)[order], feet.length_ns)
    return loop, np.concatenate(which)[order].tolist()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    seconds = parser.parse_args().seconds
    own, other = process.cpus()
    loop, which = saturated(seed=0)
    with Child("lib.timed_daemon", buses=BUSES, seconds=seconds - 3, warm_up=2, cpu=own) as measured_daemon:
        ready = measured_daemon.report()
        with Child("lib.subscriber", endpoint=ready["endpoint"], cpu=other) as subscriber:
            subscriber.report()
            time.sleep(0.5)
            process.settle(other, punctual=True)
            fed = play([connect(to) for to in ready["feeds"]], which, loop, seconds)
            time.sleep(0.5)
            report, received = measured_daemon.end(), subscriber.end()
    print(
        f"frames: {fed['sent']} sent at {fed['frames_per_s']:.0f} a second, {fed['sent'] - report['frames']} lost "
        f"({report['dropped']} counted by the kernel)"
    )
    print(
        f"cycles: {json.dumps(report['published'])} published, "
        f"{sum(stream['gaps'] for stream in received.values())} messages lost at the subscriber"
    )
    print(f"CPU:    {report['cpu_percent']:.1f} % of one core")
    print(f"latency: p50 {report['latency_ms_p50']:.2f}, p99 {report['latency_ms_p99']:.2f} ms")


if __name__ == "__main__":
    main()
