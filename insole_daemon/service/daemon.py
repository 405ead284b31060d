"""The loop: frames in, a cycle published the moment its last expected half is there."""

from __future__ import annotations

import dataclasses
import time
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
import zenoh

from ..bus.frames import FrameBatch
from ..bus.source import FrameSource, collect
from ..skin.cycles import Cycles
from ..skin.streams import Streams
from ..wire.messages import Event, Health
from ..wire.publisher import FootPublisher
from .foot import Foot
from .notify import notify

_HEALTH_NS = 1_000_000_000
_IDLE_NS = 100_000_000  # how long the loop may wait while nothing has ever arrived


class Daemon:
    """Reads `source`, publishes `feet` on `session`; `run` returns after `stop`, or at the end of a log."""

    def __init__(self, source: FrameSource, feet: Sequence[Foot], session: zenoh.Session) -> None:
        self._source, self._feet = source, tuple(feet)
        self._streams = Streams([foot.layout for foot in feet])
        self._first_slot = np.cumsum([0, *(2 * foot.n_triangles for foot in feet)])
        self._publishers = [FootPublisher(session, foot.config.rig, foot.name) for foot in feet]
        self._tallies = [_Tally() for _ in feet]
        self._states: dict[int, str] = {}
        self._stopping = False
        self._started_mono_ns = time.monotonic_ns()

    def stop(self) -> None:
        """End `run` within a few hundredths of a second; safe from signal handlers and other threads."""
        self._stopping = True

    def run(self, ready: Callable[[], None] = lambda: None) -> None:
        """Publish until stopped; `ready` is called once everything is open."""
        for foot, publisher in zip(self._feet, self._publishers, strict=True):
            publisher.stand("meta", foot.meta())
            publisher.stand("calibration", foot.calibration_in_use())
        notify("READY=1", "STATUS=waiting for frames")
        ready()
        next_health_ns = time.monotonic_ns() + _HEALTH_NS
        try:
            while not self._stopping and not self._source.exhausted:
                now_ns = self._source.clock_ns()
                dues = [foot.assembler.due_ns for foot in self._feet]
                until_ns = min((due for due in dues if due is not None), default=now_ns + _IDLE_NS)
                outstanding = [foot.assembler.outstanding for foot in self._feet]
                batch, looked_ns = collect(
                    self._source, min(filter(None, outstanding), default=1 << 30), until_ns
                )
                self._take(batch)
                for index, foot in enumerate(self._feet):
                    self._publish(index, foot.assembler.advance(looked_ns))
                if time.monotonic_ns() >= next_health_ns:
                    self._report()
                    next_health_ns += _HEALTH_NS
        finally:
            notify("STOPPING=1")
            for publisher in self._publishers:
                publisher.close()

    def _take(self, batch: FrameBatch) -> None:
        if not len(batch):
            return
        slots = self._streams.slots(batch)
        for index, foot in enumerate(self._feet):
            first, end = self._first_slot[index], self._first_slot[index + 1]
            rows = np.flatnonzero((slots >= first) & (slots < end))
            if len(rows):
                own = slots[rows] - np.int16(first)
                self._publish(
                    index, foot.assembler.feed(own, batch.data[rows], batch.t_ns[rows], batch.t_mono_ns[rows])
                )

    def _publish(self, index: int, closed: list[Cycles]) -> None:
        """Everything that is new; of repeats that piled up, only the last."""
        foot, publisher, tally = self._feet[index], self._publishers[index], self._tallies[index]
        for number, cycles in enumerate(closed):
            for at in range(len(cycles)):
                last = number == len(closed) - 1 and at == len(cycles) - 1
                if cycles.repeated[at] and not last:
                    tally.skipped += 1
                    continue
                messages = foot.messages(cycles, at)
                for message in messages:
                    publisher.publish(message)
                tally.count(cycles, at)

    def _report(self) -> None:
        """Health of every foot, and the watchdog: it is fed by the loop that publishes, or not at all."""
        now_ns = self._source.clock_ns()
        rates = []
        for foot, publisher, tally in zip(self._feet, self._publishers, self._tallies, strict=True):
            reports = foot.survey(foot.assembler, now_ns)
            streaming = sum(report.state == "streaming" for report in reports)
            for report in reports:
                self._tell_change(foot, publisher, report.address, report.state)
            elapsed_s, latency_ms = tally.since_last_report()
            published = foot.seq - tally.reported_seq
            tally.reported_seq = foot.seq
            rates.append(published / elapsed_s)
            publisher.publish(
                Health(
                    foot=foot.name,
                    t_ns=time.time_ns(),
                    uptime_s=(time.monotonic_ns() - self._started_mono_ns) * 1e-9,
                    state="ok" if streaming == len(reports) else "degraded" if streaming else "no data",
                    cycles={
                        "published": foot.seq,
                        "late": tally.late,
                        "repeated": tally.repeated,
                        "skipped": tally.skipped + foot.assembler.skipped,
                        "superseded_halves": foot.assembler.superseded,
                        "missed_halves": int(foot.assembler.missed.sum()),
                    },
                    publish_rate_hz=published / elapsed_s,
                    latency_ms=latency_ms,
                    boards=[dataclasses.asdict(report) for report in reports],
                    bus=dataclasses.asdict(self._source.counters),
                    refused=dataclasses.asdict(self._streams.refused),
                )
            )
        notify("WATCHDOG=1", "STATUS=" + ", ".join(
            f"{foot.name} {rate:.1f} Hz" for foot, rate in zip(self._feet, rates, strict=True)
        ) + f", {self._source.counters.overflows} frames lost")  # fmt: skip

    def _tell_change(self, foot: Foot, publisher: FootPublisher, address: int, state: str) -> None:
        before = self._states.get(address, "never seen")
        self._states[address] = state
        if state != before:
            kind = {"streaming": "board_streaming", "silent": "board_silent"}.get(state, "board_never_seen")
            publisher.publish(
                Event(foot.name, time.time_ns(), kind, f"board {address}: {before} → {state}", [address])
            )


class _Tally:
    """Counters of one foot that the loop keeps for its health."""

    def __init__(self) -> None:
        self.late = self.repeated = self.skipped = self.reported_seq = 0
        self._latencies_ms: deque[float] = deque(maxlen=1000)
        self._reported_ns = time.monotonic_ns()

    def count(self, cycles: Cycles, at: int) -> None:
        """One cycle has been put."""
        self.late += bool(cycles.late[at])
        if cycles.repeated[at]:
            self.repeated += 1
        else:
            self._latencies_ms.append((time.time_ns() - int(cycles.t_ns[at])) * 1e-6)

    def since_last_report(self) -> tuple[float, dict[str, float | None]]:
        """Seconds since the last call, and the latency of the cycles since."""
        now_ns = time.monotonic_ns()
        elapsed_s, self._reported_ns = (now_ns - self._reported_ns) * 1e-9, now_ns
        if not self._latencies_ms:
            return elapsed_s, {"p50": None, "p99": None, "max": None}
        p50, p99, most = np.percentile(self._latencies_ms, [50, 99, 100]).tolist()
        self._latencies_ms.clear()
        return elapsed_s, {"p50": p50, "p99": p99, "max": most}
