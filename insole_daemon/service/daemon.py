"""The main loop: take in frames, publish each cycle as soon as its last expected half has arrived."""

from __future__ import annotations

import dataclasses
import gc
import logging
import time
from collections import deque
from collections.abc import Callable, Collection, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import zenoh

from ..bus.gate import Gate
from ..bus.recovering import RecoveringSource
from ..bus.source import FrameSource, collect, sleep_precisely
from ..compiled import kernel
from ..skin.cycles import ClosedCycle
from ..skin.quality import QualityWindow, period_ns_of
from ..skin.reader import SkinReader
from ..wire.messages import Event, Health
from ..wire.publisher import FootPublisher
from .backlog import Backlog
from .board_link import BoardLink
from .boards import BoardOperations
from .foot import Foot
from .journal import Journal
from .notify import notify
from .operations import AttendedClock, RequestDesk, Step
from .quota import OneCpu
from .reapply import keep_configured
from .reload import Reloader
from .steps import StepEvents
from .switching import model_handler
from .zeroing import zero_handler

_HEALTH_NS = 1_000_000_000  # period for each foot; the feet take turns
_CALM_NS = 3_000_000  # faults are looked for and health is published when no cycle is expected for this long,
_MOST_DEFERRED_NS = 100_000_000  # or this long after they were due
_IDLE_NS = 100_000_000  # longest wait for frames, and so the delay before signals and lost buses are noticed
_BUSY_NS = 5_000_000  # the same while a request is open: operations advance once per iteration
# The loop also publishes, so waiting costs cycles. A transmit queue that accepts no frame for this long is stuck.
_PATIENCE_S = 0.005
_ANY = 1 << 30  # more frames than ever arrive at once: only the time ends the wait

_log = logging.getLogger(__name__)


class Daemon:
    """Reads `source`, publishes `feet` on `session` and answers requests there.

    `run` returns after `stop`, or at the end of a log. A reload reads `config_file` again. Frames are sent to boards
    and changes of interfaces are published only if the source is a RecoveringSource.
    """

    def __init__(
        self, source: FrameSource, feet: Sequence[Foot], session: zenoh.Session, config_file: Path | None = None
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
        gates = self._gates = _gates(source, feet)
        self._boards = []
        for foot, assembler, desk, publisher in zip(
            feet, self._skin.assemblers, self._desks, self._publishers, strict=True
        ):
            boards = BoardOperations(BoardLink(foot, feet, assembler, gates), _teller(foot, publisher))
            self._boards.append(boards)
            desk.offer("boards", boards.handle)
            desk.offer("zero", zero_handler(foot, publisher))
            desk.offer("model", model_handler(foot, publisher))
            if foot.config.boards.configure:
                desk.keep(keep_configured(boards))
        self._tallies = [_Tally(period_ns_of(foot.insole.boards, publish.rate_hz)) for foot in feet]
        self._steps = StepEvents(self._feet)
        self._stopping = False
        self._reloader = Reloader(config_file)
        self._reload_asked = False
        self._reloads = self._reloads_refused = 0
        self._journal = Journal(_log)
        self._one_cpu = OneCpu()
        self._watch_due_ns: int | None = None  # since when the fault watch has waited; None: it does not
        self._backlog = Backlog(partial(self._journal.tell, logging.WARNING))
        self._started_mono_ns = time.monotonic_ns()
        self._health_due_ns = [self._started_mono_ns for _ in feet]
        self._rates_hz = [0.0 for _ in feet]  # at which each was published last, for the status

    def stop(self) -> None:
        """Make `run` return within some hundredths of a second; safe in signal handlers and other threads."""
        self._stopping = True

    def reload(self) -> None:
        """Read the configuration again and apply what can change in a running daemon; safe where `stop` is."""
        self._reload_asked = True

    def run(self, ready: Callable[[], None] = lambda: None) -> None:
        """Publish until stopped; `ready` is called once everything is open."""
        self._publish_latched()
        for publisher in self._publishers:
            publisher.announce()
        for foot, assembler in zip(self._feet, self._skin.assemblers, strict=True):
            foot.survey(assembler, self._source.clock_ns(), foot.stale_after_ns)  # rates are counted from here
        self._follow_buses()
        sleep_precisely()
        attended = AttendedClock()
        if kernel is None:
            self._journal.tell(logging.INFO, "computing with numpy: the compiled kernel was not built")
        gc.collect()
        gc.freeze()  # these objects live as long as the process: the collector skips them
        notify("READY=1", "STATUS=waiting for frames")
        ready()
        step_ns = _HEALTH_NS // len(self._feet)
        self._health_due_ns = [time.monotonic_ns() + place * step_ns for place in range(1, len(self._feet) + 1)]
        try:
            while not self._stopping and not self._source.exhausted:
                until_ns = self._source.clock_ns() + (_BUSY_NS if self._is_busy() else _IDLE_NS)
                due_ns, outstanding, promised_ns = self._skin.expected()
                if due_ns is not None:
                    until_ns = min(until_ns, due_ns)
                at_least = outstanding or _ANY
                if self._backlog.pause_ns:
                    self._rest()
                    at_least, promised_ns = 0, None  # those that have arrived
                batch, looked_ns = collect(self._source, at_least, until_ns, promised_ns)
                closed = self._skin.closed_cycles(batch)
                self._publish(closed)
                if due_ns is not None and looked_ns > due_ns:
                    by_time = self._skin.cycles_closed_by_time(looked_ns)
                    self._publish(by_time)
                    closed = [complete + late for complete, late in zip(closed, by_time, strict=True)]
                attended_ns = attended.turn(looked_ns)
                for desk, of_foot in zip(self._desks, closed, strict=True):
                    if not desk.idle:
                        desk.step(Step(looked_ns, [cycle.cycles for cycle in of_foot], batch, attended_ns))
                self._watch_if_due()
                self._follow_buses()
                self._follow_reload()
                if not self._backlog.pause_ns:
                    self._report_if_due()
            open_at_the_end = self._skin.cycles_closed_by_time(self._source.clock_ns())  # of a log
            self._publish(open_at_the_end)
            self._watch()
        finally:
            notify("STOPPING=1")
            for desk in self._desks:
                desk.close()
            for publisher in self._publishers:
                publisher.close()

    def _is_busy(self) -> bool:
        """Return whether a request is open or boards are being commanded."""
        is_busy = False
        for desk, boards in zip(self._desks, self._boards, strict=True):
            is_busy |= desk.busy or boards.occupied is not None
        return is_busy

    def _publish(self, closed_by_foot: list[list[ClosedCycle]]) -> None:
        """Publish the closed cycles; of accumulated repeats, and if the loop is behind of all, only the newest."""
        closing_ns = [closed[0].t_mono_ns for closed in closed_by_foot if closed]
        if not closing_ns:
            return
        began_ns = self._source.clock_ns()
        self._backlog.record_poll(min(closing_ns), began_ns)
        for foot, publisher, tally, closed in zip(
            self._feet, self._publishers, self._tallies, closed_by_foot, strict=True
        ):
            for n_left, cycle in zip(range(len(closed) - 1, -1, -1), closed, strict=True):
                if n_left:
                    self._publish_older(foot, publisher, tally, cycle, began_ns)
                else:
                    self._publish_cycle(foot, publisher, tally, cycle)

    def _publish_older(
        self, foot: Foot, publisher: FootPublisher, tally: _Tally, cycle: ClosedCycle, began_ns: int
    ) -> None:
        """Publish or skip a cycle that is not the newest one; publishing began at `began_ns`."""
        if self._backlog.newest_only(self._source.clock_ns() - began_ns):
            tally.skipped += 1
            return
        if cycle.is_repeated:
            tally.skipped += 1
            foot.skip(cycle)
        else:
            self._publish_cycle(foot, publisher, tally, cycle)
        self._tell_faults(foot, publisher)

    def _publish_cycle(self, foot: Foot, publisher: FootPublisher, tally: _Tally, cycle: ClosedCycle) -> None:
        payloads, load = foot.payloads(cycle)
        publisher.put(payloads)
        tally.count(cycle)
        step = self._steps.take(foot, cycle.t_mono_ns, load)
        if step is not None:
            publisher.publish(step)

    def _watch_if_due(self) -> None:
        """Run the fault watch of all feet if one is due: the second foot's finds the caches warm."""
        if not any(foot.is_watch_due for foot in self._feet):
            return
        now_ns = time.monotonic_ns()
        self._watch_due_ns = self._watch_due_ns or now_ns
        if self._backlog.pause_ns or now_ns - self._watch_due_ns > _MOST_DEFERRED_NS or self._is_calm():
            self._watch()

    def _watch(self) -> None:
        self._watch_due_ns = None
        for foot, publisher in zip(self._feet, self._publishers, strict=True):
            self._tell_faults(foot, publisher, early=True)

    def _tell_faults(self, foot: Foot, publisher: FootPublisher, early: bool = False) -> None:
        for event in foot.fault_events(early):
            publisher.publish(event)

    def _publish_latched(self) -> None:
        """Publish `meta` and `calibration`, and keep them for late joiners."""
        for foot, publisher in zip(self._feet, self._publishers, strict=True):
            publisher.publish_latched("meta", foot.meta())
            publisher.publish_latched("calibration", foot.calibration_in_use())

    def _follow_buses(self) -> None:
        """Publish changes of interfaces as events of the feet whose boards are on them."""
        if not isinstance(self._source, RecoveringSource):
            return
        for change in self._source.changes():
            self._journal.tell(logging.INFO if change.state == "up" else logging.WARNING, change.text)
            kind = "bus_off" if change.state == "bus-off" else f"bus_{change.state}"
            for foot, publisher in zip(self._feet, self._publishers, strict=True):
                boards = [b.address for b in foot.insole.boards if b.interface == change.interface]
                if boards:
                    publisher.publish(Event(foot.name, change.t_ns, kind, change.text, boards))

    def _follow_reload(self) -> None:
        """Start a requested reload, and apply the result of a finished one; no cycle is half published now."""
        reloader = self._reloader
        if not (self._reload_asked or reloader.busy):
            return
        running = tuple(foot.setup for foot in self._feet)
        if self._reload_asked and not reloader.busy:
            self._reload_asked = False
            notify("RELOADING=1", f"MONOTONIC_USEC={time.monotonic_ns() // 1000}")
            reloader.start(running)
        reloaded = reloader.take() if reloader.busy else None
        if reloaded is None:
            return
        if reloaded.before != running:  # a zero was taken meanwhile, and the file may have been read before
            reloader.start(running)
            return
        self._reloads_refused += reloaded.refused is not None
        self._reloads += reloaded.refused is None
        if reloaded.pipelines:
            for foot, pipeline in zip(self._feet, reloaded.pipelines, strict=True):
                foot.replace_pipeline(pipeline)
            self._publish_latched()
        for kind, text in reloaded.events():
            level = logging.INFO if kind == "reloaded" else logging.WARNING
            self._journal.tell(level, f"{kind.replace('_', ' ')}: {text}")
            for foot, publisher in zip(self._feet, self._publishers, strict=True):
                publisher.publish(Event(foot.name, time.time_ns(), kind, text, []))
        notify("READY=1")

    def _rest(self) -> None:
        """Sleep until the next poll; publish health half-way, when the last messages have been sent."""
        now_ns = self._source.clock_ns()
        look_ns = self._skin.best_poll_ns(now_ns + self._backlog.pause_ns)
        if min(self._health_due_ns) - time.monotonic_ns() < look_ns - now_ns:  # the clock of a log is another one
            time.sleep((look_ns - now_ns) * 0.5e-9)
            self._report_if_due(is_resting=True)
        time.sleep(max(0, look_ns - self._source.clock_ns()) * 1e-9)

    def _report_if_due(self, is_resting: bool = False) -> None:
        now_ns = time.monotonic_ns()
        late_ns = now_ns - min(self._health_due_ns)
        if late_ns < 0 or not (is_resting or late_ns > _MOST_DEFERRED_NS or self._is_calm()):
            return
        for place, due_ns in enumerate(self._health_due_ns):
            if due_ns <= now_ns:
                if place == 0:
                    self._backlog.has_quota = self._one_cpu.follow()
                self._report(place)
                periods = (now_ns - due_ns) // _HEALTH_NS + 1  # missed reports are not made up for
                self._health_due_ns[place] += periods * _HEALTH_NS

    def _is_calm(self) -> bool:
        """Return whether no cycle is expected within _CALM_NS."""
        promised_ns = self._skin.expected().promised_ns
        return promised_ns is None or promised_ns - self._source.clock_ns() > _CALM_NS

    def _report(self, place: int) -> None:
        """Publish the health of the foot at index `place`, and notify the watchdog of the service manager."""
        self._journal.sum_up()
        now_ns = self._source.clock_ns()
        bus = self._source.counters
        foot, assembler, publisher = self._feet[place], self._skin.assemblers[place], self._publishers[place]
        desk, tally = self._desks[place], self._tallies[place]
        reports = foot.survey(assembler, now_ns, foot.stale_after_ns)
        streaming = sum(report.state == "streaming" for report in reports)
        elapsed_s, latency_ms = tally.since_last_report()
        faults = foot.faults()
        published = foot.seq - tally.reported_seq
        tally.reported_seq = foot.seq
        self._rates_hz[place] = published / elapsed_s
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
                    "extrapolated": foot.extrapolated,
                    "beyond": foot.beyond,
                },
                publish_rate_hz=published / elapsed_s,
                quality=tally.quality.report(time.monotonic_ns()).document(),
                latency_ms=latency_ms,
                boards=[dataclasses.asdict(report) for report in reports],
                faults=faults,
                bus=dataclasses.asdict(bus),
                refused=_with_text_keys(dataclasses.asdict(self._skin.streams.refused)),
                asked={
                    "requests_done": desk.done,
                    "requests_refused": desk.refused,
                    "reloads_done": self._reloads,
                    "reloads_refused": self._reloads_refused,
                    "commands_sent": sum(gate.sent for gate in self._gates.values()),
                    "commands_refused": sum(gate.refused for gate in self._gates.values()),
                },
            )
        )
        notify("WATCHDOG=1", "STATUS=" + ", ".join(
            f"{foot.name} {rate:.1f} Hz" for foot, rate in zip(self._feet, self._rates_hz, strict=True)
        ) + f", {bus.overflows} frames lost" + "".join(
            f", {name} {interface.state}" for name, interface in bus.interfaces.items() if interface.state != "up"
        ))  # fmt: skip


def _with_text_keys(counts: dict[str, Any]) -> dict[str, Any]:
    """Return a copy in which every key is text; counts by board address have numbers as keys."""
    return {str(key): _with_text_keys(count) if isinstance(count, dict) else count for key, count in counts.items()}


def _gates(source: FrameSource, feet: Sequence[Foot]) -> dict[str, Gate]:
    """Return the gate to the boards of each interface, by the name of the interface."""
    configure = feet[0].config.boards.configure
    if isinstance(source, RecoveringSource):
        return {name: Gate(partial(source.sink, name, _PATIENCE_S), configure) for name in source.interfaces}
    return {board.interface: Gate(None, configure) for foot in feet for board in foot.insole.boards}


def _teller(foot: Foot, publisher: FootPublisher) -> Callable[[str, str, Collection[int]], None]:
    def tell(kind: str, text: str, boards: Collection[int]) -> None:
        publisher.publish(Event(foot.name, time.time_ns(), kind, text, sorted(boards)))

    return tell


class _Tally:
    """The counters of one foot that its health reports."""

    def __init__(self, period_ns: int) -> None:
        self.quality = QualityWindow(period_ns)
        self.late = self.repeated = self.skipped = self.reported_seq = 0
        self._latencies_ms: deque[float] = deque(maxlen=1000)
        self._reported_ns = time.monotonic_ns()

    def count(self, cycle: ClosedCycle) -> None:
        """Count one published cycle."""
        self.quality.count(cycle.is_late, cycle.is_repeated)
        self.late += cycle.is_late
        if cycle.is_repeated:
            self.repeated += 1
        else:
            self._latencies_ms.append((time.time_ns() - cycle.t_ns) * 1e-6)

    def since_last_report(self) -> tuple[float, dict[str, float | None]]:
        """Return the seconds since the last call, and the latencies of the cycles since then."""
        now_ns = time.monotonic_ns()
        elapsed_s, self._reported_ns = (now_ns - self._reported_ns) * 1e-9, now_ns
        if not self._latencies_ms:
            return elapsed_s, {"p50": None, "p99": None, "max": None}
        p50, p99, most = np.percentile(self._latencies_ms, [50, 99, 100]).tolist()
        self._latencies_ms.clear()
        return elapsed_s, {"p50": p50, "p99": p99, "max": most}
