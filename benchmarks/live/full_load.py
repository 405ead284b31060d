"""CPU and latency of the daemon at the load of both feet, beside a minimal reader and a python-can reader.

    python -m benchmarks.live.full_load                   # interleaved rounds, medians and ratios
    python -m benchmarks.live.full_load --soak 600        # losses, rate and memory of the daemon
    python -m benchmarks.live.full_load --bus vcan0       # on a CAN interface instead of UDP on loopback

Frames come one by one at their bus times. The measured program has one CPU for itself where there are two; feeder
and subscriber run on another, as the boards and a person's program would.

Takes about 6 minutes.
"""

from __future__ import annotations

import argparse
import statistics
import time
from typing import Any

from benchmarks.lib import process
from benchmarks.lib.process import Child

PROGRAMS = {
    "floor": "live.floor",
    "insole-daemon": "lib.timed_daemon",
    "python-can peer": "live.peer_pythoncan",
}
OURS, FLOOR, PEER = "insole-daemon", "floor", "python-can peer"
WARM_UP_S = 2.0
FRAMES_PER_CYCLE = 56


def once(script: str, bus: str, seconds: float, seed: int) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """What the measured program, the subscriber and the feeder report of one run."""
    own, other = process.cpus()
    with Child(script, bus=bus, seconds=seconds, warm_up=WARM_UP_S, cpu=own) as measured:
        ready = measured.report()
        with Child("lib.subscriber", endpoint=ready["endpoint"], cpu=other) as subscriber:
            subscriber.report()
            time.sleep(0.5)  # until the subscription has reached the publisher
            with Child(
                "lib.feeder", to=ready["feeds"][0], seconds=WARM_UP_S + seconds + 0.5, seed=seed, cpu=other
            ) as feeder:
                fed = feeder.report()
            time.sleep(0.5)
            report = measured.end()
            received = subscriber.end()
    return report, received, fed


def compare(bus: str, rounds: int, seconds: float) -> None:
    """All three in turn, `rounds` times; the medians."""
    reports: dict[str, list[dict[str, Any]]] = {name: [] for name in PROGRAMS}
    for seed in range(rounds):
        for name, script in PROGRAMS.items():
            report, _, fed = once(script, bus, seconds, seed)
            assert report["frames"] == fed["sent"], "frames lost: the figures would be of less work"
            reports[name].append(report)
            print(
                f"round {seed + 1}  {name:16} CPU {report['cpu_percent']:5.2f} %   latency p50 "
                f"{report['latency_ms_p50']:.3f} p99 {report['latency_ms_p99']:.3f} ms   fed "
                f"{fed['late_ms_p99']:.2f} ms late (p99)",
                flush=True,
            )
    median = {
        name: {key: statistics.median(run[key] for run in runs) for key in
               ("cpu_percent", "latency_ms_p50", "latency_ms_p99", "wake_ups_per_cycle")}
        for name, runs in reports.items()
    }  # fmt: skip
    print(f"\n| median of {rounds} × {seconds:g} s | CPU | p50 | p99 | wake-ups a cycle |\n|---|---|---|---|---|")
    for name, of in median.items():
        print(
            f"| {name} | {of['cpu_percent']:.2f} % | {of['latency_ms_p50']:.3f} ms | {of['latency_ms_p99']:.3f} ms "
            f"| {of['wake_ups_per_cycle']:.1f} |"
        )

    def ratio(key: str, to: str) -> float:
        """Of the two in the same round, the median."""
        return statistics.median(a[key] / b[key] for a, b in zip(reports[OURS], reports[to], strict=True))

    print(f"\nCPU: {ratio('cpu_percent', FLOOR):.2f} × the floor, {ratio('cpu_percent', PEER):.2f} × the peer")
    behind_ms = median[OURS]["latency_ms_p50"] - median[FLOOR]["latency_ms_p50"]
    print(f"latency: p50 floor + {behind_ms:.2f} ms, p99 {ratio('latency_ms_p99', FLOOR):.2f} × the floor's")


def soak(bus: str, seconds: float) -> None:
    """The daemon alone; what was lost, how steady it was, and its memory."""
    report, received, fed = once(PROGRAMS[OURS], bus, seconds, seed=0)
    print(
        f"frames: {fed['sent']} sent at {fed['frames_per_s']:.0f} a second, {fed['sent'] - report['frames']} lost "
        f"({report['dropped']} counted by the kernel)"
    )
    cycles = fed["sent"] // FRAMES_PER_CYCLE
    print(f"cycles: {sum(report['published'].values())} published, of {cycles} that were sent")
    for key, stream in received.items():
        print(f"        {key:15} {stream['gaps']} lost at the subscriber, {stream['rate_hz']:.3f} Hz")
    rss = report["rss_mb"]
    print(f"memory: {rss[0]:.1f} MB in the first second, {rss[-1]:.1f} MB in the last, {max(rss):.1f} MB at most")
    print(f"CPU:    {report['cpu_percent']:.2f} % of one core")
    print(
        f"latency: p50 {report['latency_ms_p50']:.3f}, p99 {report['latency_ms_p99']:.3f}, "
        f"longest {report['latency_ms_max']:.3f} ms"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bus", default="udp", help="udp, or a CAN interface such as vcan0")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=20.0, help="of every run that are measured")
    parser.add_argument("--soak", type=float, metavar="SECONDS", help="run the daemon alone for so long")
    options = parser.parse_args()
    if options.soak is not None:
        soak(options.bus, options.soak)
    else:
        compare(options.bus, options.rounds, options.seconds)


if __name__ == "__main__":
    main()
