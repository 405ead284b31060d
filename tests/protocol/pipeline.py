"""The real pipeline on golden logs: as a replay at once, and as the daemon's own loop in a time of its own."""

from __future__ import annotations

import dataclasses
import json
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from insole_daemon.bus import source as source_module
from insole_daemon.bus.candump import read
from insole_daemon.bus.error_frames import count_kinds
from insole_daemon.bus.frames import FrameBatch
from insole_daemon.bus.replay import CandumpSource
from insole_daemon.bus.source import BusCounters, collect
from insole_daemon.config import Board, Config, Contact, Insole, Publish
from insole_daemon.physics.effect import Effect
from insole_daemon.service import daemon as daemon_module
from insole_daemon.service import foot as foot_module
from insole_daemon.service.daemon import Daemon
from insole_daemon.service.foot import Foot, load_feet
from insole_daemon.service.foot_setup import load_setups
from insole_daemon.skin.reader import SkinReader
from insole_daemon.wire.messages import Message, Models, Pressure, Raw, Wrench
from insole_daemon.wire.session import open_session

GOLDEN = Path(__file__).parents[2] / "protocol" / "golden"
NAMES = sorted(path.stem for path in GOLDEN.glob("*.log"))


def golden(name: str) -> dict[str, Any]:
    """The golden file of that name."""
    return json.loads((GOLDEN / f"{name}.json").read_text())


def log_of(name: str) -> Path:
    return GOLDEN / f"{name}.log"


def config_of(name: str) -> Config:
    """The configuration that a golden file states."""
    file = golden(name)
    settings = file["settings"]
    return Config(
        rig="golden",
        insoles=tuple(
            Insole(
                foot=foot["foot"],
                layout=GOLDEN / foot["layout"],
                boards=tuple(Board(interface="can0", **board) for board in foot["boards"]),
            )
            for foot in file["feet"]
        ),
        publish=Publish(**{key: settings[key] for key in ("rate_hz", "slack_ms", "stale_after_ms")}),
        contact=Contact(
            **{key: settings[key] for key in ("activation_threshold_count", "min_force_n", "min_pressure_pa")}
        ),
    )


@dataclass
class Published:
    """What came out: every cycle of each foot, what else was published, and the reader it came from."""

    cycles: list[list[tuple[Raw, Pressure, Wrench]]]
    skin: SkinReader
    others: list[Message] = field(default_factory=list)
    models: list[list[Models]] = field(default_factory=list)


def at_once(name: str, effects: tuple[Effect, ...] = ()) -> Published:
    """The log through the steps of the daemon's loop, without Zenoh and with every repeat.

    `effects` of the calibrations of both feet.
    """
    config = config_of(name)
    source = CandumpSource(log_of(name), speed=None)
    feet = [
        Foot(dataclasses.replace(setup, calibration=dataclasses.replace(setup.calibration, effects=effects)))
        for setup in load_setups(config)
    ]
    skin = SkinReader(
        [foot.layout for foot in feet],
        period_ns=round(1e9 / config.publish.rate_hz),
        slack_ns=round(config.publish.slack_ms * 1e6),
    )
    published: list[list[tuple[Raw, Pressure, Wrench]]] = [[] for _ in feet]
    models: dict[str, list[Models]] = defaultdict(list)
    while not source.exhausted:
        batch, _ = collect(source, 1 << 30, source.clock_ns() - 1)
        for closed_by_foot in (skin.feed(batch), skin.advance(source.clock_ns())):
            for foot, closed, messages in zip(feet, closed_by_foot, published, strict=True):
                for cycles in closed:
                    for at in range(len(cycles)):
                        *cycle, both = foot.messages(cycles, at)
                        messages.append(tuple(cycle))
                        if both is not None:
                            models[foot.name].append(both)
                        foot.fault_events()
    return Published(published, skin, models=list(models.values()))


class VirtualBus:
    """A log as a live bus in a time of its own, which passes only while somebody waits."""

    def __init__(self, path: Path) -> None:
        log = read(path)
        self.frames, self.interfaces, self.counters = log.frames, log.interfaces, BusCounters()
        self.now_ns = int(self.frames.t_mono_ns[0]) - 30_000_000
        self._received = self._drained = 0

    @property
    def exhausted(self) -> bool:
        return self._received == len(self.frames)

    def receive(self) -> int:
        self._received = int(np.searchsorted(self.frames.t_mono_ns, self.now_ns, side="right"))
        return self._received - self._drained

    def drain(self) -> FrameBatch:
        batch = self.frames[self._drained : self._received]
        self._drained = self._received
        self.counters.frames += len(batch)
        count_kinds(batch, self.counters.error_frames)
        return batch

    def clock_ns(self) -> int:
        return self.now_ns

    def wait(self, timeout_s: float) -> None:
        until_ns = self.now_ns + int(timeout_s * 1e9)
        if not self.exhausted:
            until_ns = min(until_ns, int(self.frames.t_mono_ns[self._received]))
        self.now_ns = max(self.now_ns, until_ns)

    def sleep(self, seconds: float) -> None:
        """Time passes whatever arrives; never beyond the log's end, where it stops."""
        self.now_ns = min(self.now_ns + int(seconds * 1e9), int(self.frames.t_mono_ns[-1]))

    def close(self) -> None:
        pass


def live(
    name: str, monkeypatch: pytest.MonkeyPatch, health_every_ns: int = 100_000_000, cycle_costs_ns: int = 0
) -> Published:
    """The log through the daemon itself; only the publishers and the clock are replaced.

    `cycle_costs_ns`: publishing one cycle takes so long, on a bus that goes on meanwhile.
    """
    bus = VirtualBus(log_of(name))
    published: dict[str, list[Message]] = defaultdict(list)

    class Publisher:
        def __init__(self, session: object, rig: str, foot: str) -> None:
            self.messages = published[foot]

        def publish(self, *messages: Message) -> None:
            self.messages += messages

        def put(self, payloads: Sequence[tuple[type[Message], bytes]]) -> None:
            self.messages += [message.decode(payload) for message, payload in payloads]
            bus.sleep(cycle_costs_ns * 1e-9)

        def publish_latched(self, what: str, message: Message) -> None:
            self.messages.append(message)

        def announce(self) -> None:
            pass

        def close(self) -> None:
            pass

    # The real times of the log are the monotonic ones here, but for a step that a log may have.
    clock = SimpleNamespace(monotonic_ns=bus.clock_ns, time_ns=bus.clock_ns, sleep=bus.sleep)
    monkeypatch.setattr(source_module, "time", clock)
    monkeypatch.setattr(daemon_module, "time", clock)
    monkeypatch.setattr(foot_module, "time", clock)
    monkeypatch.setattr(daemon_module, "FootPublisher", Publisher)
    monkeypatch.setattr(daemon_module, "_HEALTH_NS", health_every_ns)
    feet = load_feet(config_of(name))
    session = open_session("peer")
    try:
        daemon = Daemon(bus, feet, session)
        daemon.run()
    finally:
        session.close()
    cycles = []
    for foot in feet:
        own = [message for message in published[foot.name] if isinstance(message, Raw | Pressure | Wrench)]
        cycles.append(list(zip(own[0::3], own[1::3], own[2::3], strict=True)))
    others = [m for of in published.values() for m in of if not isinstance(m, Raw | Pressure | Wrench)]
    return Published(cycles, daemon._skin, others)
