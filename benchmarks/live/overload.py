"""Age, rate and counted losses of messages if the daemon gets a third of the CPU time it needs.

    python -m benchmarks.live.overload [--seconds 20] [--percent 4.2] [--one-cpu]

Both feet walk on one bus. First the daemon runs freely, and what it needs is measured; then the kernel gives it a third
of that, or so many percent of a CPU. In both it has precedence over whatever else runs on the host. The age of a cycle
is from the kernel's stamp on its newest frame until it has arrived at a subscriber, which is as punctual as this host
can be.

Takes about a minute and a half.
"""

from __future__ import annotations

import argparse
import os
import threading
import time
from dataclasses import dataclass, field

import numpy as np

import insole_daemon
from benchmarks.lib import process
from benchmarks.lib.process import Child
from benchmarks.lib.quota import Group
from insole_daemon.wire.messages import Health, Wrench

_SETTLE_S = 2.0
_ADAPT_S = 5.0  # until the daemon has found the rate that it can keep
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


@dataclass
class Seen:
    """What a subscriber saw in one phase."""

    ages_ms: list[float] = field(default_factory=list)
    healths: list[Health] = field(default_factory=list)
    seconds: float = 0.0

    def summary(self) -> str:
        if not self.ages_ms:
            return "nothing came"
        p50, p99, most = np.percentile(self.ages_ms, [50, 99, 100])
        rates_hz = [health.publish_rate_hz for health in self.healths]
        return (
            f"{len(self.ages_ms) / self.seconds / 2:.1f} Hz a foot, health says {np.mean(rates_hz):.1f} Hz; "
            f"age p50 {p50:.1f}, p99 {p99:.1f}, longest {most:.1f} ms"
        )


class Subscriber:
    """Takes wrenches and health of both feet for as long as a phase lasts."""

    def __init__(self, insole: insole_daemon.Client) -> None:
        self._seen: Seen | None = None
        self.last_health: dict[str, Health] = {}
        for messages in (insole.wrenches(), insole.healths()):
            threading.Thread(target=self._take, args=(messages,), daemon=True).start()

    def _take(self, messages: object) -> None:
        for message in messages:  # type: ignore[attr-defined]
            seen = self._seen
            if isinstance(message, Health):
                self.last_health[message.foot] = message
                if seen is not None:
                    seen.healths.append(message)
            elif isinstance(message, Wrench) and seen is not None and not message.repeated:
                seen.ages_ms.append((time.time_ns() - message.t_ns) * 1e-6)

    def phase(self, seconds: float) -> Seen:
        seen, began = Seen(), time.monotonic()
        self._seen = seen
        time.sleep(seconds)
        self._seen = None
        seen.seconds = time.monotonic() - began
        return seen


def cpu_s(pid: int) -> float:
    """User and system time of all threads of the process."""
    with open(f"/proc/{pid}/stat") as file:
        fields = file.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="of every phase")
    parser.add_argument("--percent", type=float, help="of a CPU that it gets; left out: a third of what it needs")
    parser.add_argument("--one-cpu", action="store_true", help="all threads of the daemon on one CPU")
    parser.add_argument("--periods-ms", type=float, nargs="+", default=[100.0, 50.0], help="of the quota")
    options = parser.parse_args()
    total_s = (1 + len(options.periods_ms)) * (options.seconds + _ADAPT_S) + 5
    cpu = process.cpus()[0] if options.one_cpu else None
    with Child("lib.timed_daemon", seconds=total_s, cpu=cpu) as daemon:
        ready = daemon.report()
        with (
            Child("lib.feeder", to=ready["feeds"][0], seconds=total_s) as feeder,
            Group(daemon.pid) as group,
        ):
            process.settle(None, punctual=True)
            with insole_daemon.connect(ready["endpoint"]) as insole:
                subscriber = Subscriber(insole)
                time.sleep(_SETTLE_S)
                before_s, began = cpu_s(daemon.pid), time.monotonic()
                free = subscriber.phase(options.seconds)
                need = (cpu_s(daemon.pid) - before_s) / (time.monotonic() - began)
                print(
                    f"{100 * need:.1f} % of a CPU, no limit: {free.summary()}; load {os.getloadavg()[0]:.1f}",
                    flush=True,
                )
                for period_ms in options.periods_ms:
                    share = need / 3 if options.percent is None else options.percent / 100
                    limit = group.limit(share, period_ms)
                    time.sleep(_ADAPT_S)
                    print(f"{limit}: {subscriber.phase(options.seconds).summary()}", flush=True)
                group.limit(1.0, 100.0)
                fed = feeder.report()
                time.sleep(1.5)  # the last health
                health = subscriber.last_health
        report = daemon.end()
    print(
        f"frames: {fed['sent']} sent, {report['frames']} read, {report['dropped']} dropped by the full queue, counted"
    )
    for foot, last in health.items():
        print(f"{foot}: {last.cycles['published']} cycles published, {last.cycles['skipped']} left out, counted")
    print(f"frames not accounted for: {fed['sent'] - report['frames'] - report['dropped']}")


if __name__ == "__main__":
    main()
