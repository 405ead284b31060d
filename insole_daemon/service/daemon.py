"""The loop: frames in, a cycle published the moment its last expected half is there."""

from __future__ import annotations

import dataclasses
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
import zenoh

from ..bus.gate import Gate
from ..bus.source import FrameSource, collect
from ..skin.cycles import Cycles
from ..skin.reader import SkinReader
from ..wire.messages import Event, Health
from ..wire.publisher import FootPublisher
from .board_link import BoardLink
from .boards import BoardOperations
from .foot import Foot
from .notify import notify
from .operations import RequestDesk, Step
from .reapply import keep_configured
from .zeroing import zero_handler

_HEALTH_NS = 1_000_000_000
_IDLE_NS = 100_000_000  # how long the loop may wait while nothing has ever arrived
_BUSY_NS = 5_000_000  # how long it may wait while a request runs: operations count time in its turns
_ANY = 1 << 30  # more frames than ever come at once: only the time ends the wait


class Daemon:
    """Reads `source`, publishes `feet` on `session`, and does what is asked of it there.

    `run` returns after `stop`, or at the end of a log. `gates`, by channel, are the ways to the boards, and not the
    daemon's to close; without them it sends nothing.
    """

    def __init__(
        self,
        source: FrameSource,
        feet: Sequence[Foot],
        session: zenoh.Session,
        gates: Mapping[str, Gate] | None = None,
    ) -> None:
        self._source, self._feet = source, tuple(feet)
        publish = feet[0].config.publish
        self._skin = SkinReader(
            [foot.layout for foot in feet],
            period_ns=round(1e9 / publish.rate_hz),
            slack_ns=round(publish.slack_ms * 1e6),
        )
        self._publishers = [FootPublisher(session, foot.config.rig, foot.name) for foot in feet]
        self._desks = [RequestDesk(session, foot.config.rig, foot.name) for foot in feet]
        if gates is None:
            gates = {channel: Gate(None, foot.config.boards.configure) for foot in feet for channel in _channels(foot)}
        for foot, assembler, desk, publisher in zip(
            feet, self._skin.assemblers, self._desks, self._publishers, strict=True
        ):
            boards = BoardOperations(BoardLink(foot, feet, assembler, gates), _teller(foot, publisher))
            desk.offer("boards", boards.handle)
            desk.offer("zero", zero_handler(foot, publisher))
            if foot.config.boards.configure:
                desk.keep(keep_configured(boards))
        self._tallies = [_Tally() for _ in feet]
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
        for foot, assembler in zip(self._feet, self._skin.assemblers, strict=True):
            foot.survey(assembler, self._source.clock_ns())  # rates are counted from here
        notify("READY=1", "STATUS=waiting for frames")
        ready()
        next_health_ns = time.monotonic_ns() + _HEALTH_NS
        try:
            while not self._stopping and not self._source.exhausted:
                due_ns = self._skin.due_ns()
                until_ns = due_ns if due_ns is not None else self._source.clock_ns() + _IDLE_NS
                if any(desk.busy for desk in self._desks):
                    until_ns = min(until_ns, self._source.clock_ns() + _BUSY_NS)
                batch, looked_ns = collect(
                    self._source, self._skin.outstanding() or _ANY, until_ns, self._skin.promised_ns()
                )
                fed = self._skin.feed(batch)
                self._publish(fed)
                advanced = self._skin.advance(looked_ns)
                self._publish(advanced)
                for desk, complete, by_time in zip(self._desks, fed, advanced, strict=True):
                    desk.step(Step(looked_ns, complete + by_time, batch))
                if time.monotonic_ns() >= next_health_ns:
                    self._report()
                    next_health_ns += _HEALTH_NS
            self._publish(self._skin.advance(self._source.clock_ns()))  # what a log leaves open at its end
        finally:
            notify("STOPPING=1")
            for desk in self._desks:
                desk.close()
            for publisher in self._publishers:
                publisher.close()

    def _publish(self, closed_by_foot: list[list[Cycles]]) -> None:
        """Everything that is new; of repeats that piled up, only the last."""
        for foot, publisher, tally, closed in zip(
            self._feet, self._publishers, self._tallies, closed_by_foot, strict=True
        ):
            for number, cycles in enumerate(closed, 1):
                for at in range(len(cycles)):
                    for event in foot.watch(cycles, at):
                        publisher.publish(event)
                    if cycles.repeated[at] and (number, at) != (len(closed), len(cycles) - 1):
                        tally.skipped += 1
                        continue
                    for message in foot.messages(cycles, at):
                        publisher.publish(message)
                    tally.count(cycles, at)

    def _report(self) -> None:
        """Health of every foot, and the watchdog: it is fed by the loop that publishes, or not at all."""
        now_ns = self._source.clock_ns()
        rates = []
        for foot, assembler, publisher, tally in zip(
            self._feet, self._skin.assemblers, self._publishers, self._tallies, strict=True
        ):
            reports = foot.survey(assembler, now_ns)
            streaming = sum(report.state == "streaming" for report in reports)
            elapsed_s, latency_ms = tally.since_last_report()
            faults = foot.faults()
            published = foot.seq - tally.reported_seq
            tally.reported_seq = foot.seq
            rates.append(published / elapsed_s)
            publisher.publish(
                Health(
                    foot=foot.name,
                    t_ns=time.time_ns(),
                    uptime_s=(time.monotonic_ns() - self._started_mono_ns) * 1e-9,
                    state="no data" if not streaming else "degraded" if faults or streaming < len(reports) else "ok",
                    cycles={
                        "published": foot.seq,
                        "late": tally.late,
                        "repeated": tally.repeated,
                        "skipped": tally.skipped + assembler.skipped,
                        "superseded_halves": assembler.superseded,
                        "missed_halves": int(assembler.missed.sum()),
                    },
                    publish_rate_hz=published / elapsed_s,
                    latency_ms=latency_ms,
                    boards=[dataclasses.asdict(report) for report in reports],
                    faults=faults,
                    bus=dataclasses.asdict(self._source.counters),
                    refused=_with_text_keys(dataclasses.asdict(self._skin.streams.refused)),
                )
            )
        notify("WATCHDOG=1", "STATUS=" + ", ".join(
            f"{foot.name} {rate:.1f} Hz" for foot, rate in zip(self._feet, rates, strict=True)
        ) + f", {self._source.counters.overflows} frames lost")  # fmt: skip


def _with_text_keys(counts: dict[str, Any]) -> dict[str, Any]:
    """The same with every key a text: what is counted by address is a map whose keys are numbers."""
    return {str(key): _with_text_keys(each) if isinstance(each, dict) else each for key, each in counts.items()}


def _channels(foot: Foot) -> list[str]:
    return [board.interface for board in foot.insole.boards]


def _teller(foot: Foot, publisher: FootPublisher) -> Callable[[str, str, Collection[int]], None]:
    def tell(kind: str, text: str, boards: Collection[int]) -> None:
        publisher.publish(Event(foot.name, time.time_ns(), kind, text, sorted(boards)))

    return tell


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
