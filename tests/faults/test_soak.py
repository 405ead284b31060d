"""Minutes of a small insole through the daemon, faults at random: every frame is in a cycle or counted, by reason.

The parts are those of `benchmarks/endurance/soak.py`, which runs both feet for a day: time is injected, and only
`recvmmsg` and the publishers are replaced.
"""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from benchmarks.endurance.soak_bus import Clock, accounts
from benchmarks.endurance.soak_faults import Day, FaultyBus
from insole_daemon import config as configs
from insole_daemon.bus import link
from insole_daemon.bus.sink import can_frames
from insole_daemon.service import daemon as daemons
from insole_daemon.service.foot import load_feet
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.foot import Walk
from insole_daemon.wire.messages import Health, Wrench
from insole_daemon.wire.session import open_session

SECONDS = 240
LAYOUT = """\
format: insole-layout/1
foot: left
taxel_area_mm2: 32.4
triangles:
- {board: 5, triangle: 0, patch: front, x_mm: 231.5, y_mm: 12.0, rotation_deg: 0.0}
- {board: 6, triangle: 3, patch: middle, x_mm: 131.5, y_mm: 0.0, rotation_deg: 90.0}
- {board: 7, triangle: 1, patch: rear, x_mm: 31.5, y_mm: -2.0, rotation_deg: 180.0}
"""
CONFIG = """\
format: insole-config/1
rig: soak
insoles:
- foot: left
  layout: layout.yaml
  boards: [{address: 5, interface: can0}, {address: 6, interface: can0}, {address: 7, interface: can0}]
"""


@pytest.mark.parametrize("seed", [1, 2])
def test_every_frame_of_minutes_with_faults_at_random_is_used_or_refused_and_counted(monkeypatch, tmp_path, seed):
    (tmp_path / "layout.yaml").write_text(LAYOUT)
    config_file = tmp_path / "config.yaml"
    config_file.write_text(CONFIG)
    config = configs.load(config_file)
    feet = load_feet(config)
    layouts = [foot.layout for foot in feet]
    frames = Emulator(config, layouts, Walk(layouts, seed=seed), seed=seed).frames(0, 10)
    walk = SimpleNamespace(rows=can_frames(frames), t_ns=frames.t_ns - frames.t_ns[0])

    clock, day = Clock(speed=float("inf")), Day(seed, [walk], every_s=3)
    clock.inject(monkeypatch.setattr)
    monkeypatch.setattr(link, "open_bus", link.open_bus)  # the bus puts its own there
    bus = FaultyBus(clock, config_file, day)
    end_ns = clock.monotonic_ns() + SECONDS * 1_000_000_000
    numbers: list[int] = []
    healths: list[Health] = []

    class Publisher:
        def __init__(self, *_) -> None:
            pass

        def put(self, payloads) -> None:
            numbers.extend(Wrench.decode(payload).seq for message, payload in payloads if message is Wrench)

        def publish(self, message) -> None:
            if isinstance(message, Health):
                healths.append(message)
                if clock.monotonic_ns() >= end_ns:
                    daemon.stop()

        def publish_latched(self, *_) -> None:
            pass

        def announce(self) -> None:
            pass

        def close(self) -> None:
            pass

    monkeypatch.setattr(daemons, "FootPublisher", Publisher)
    session = open_session("peer")
    try:
        daemon = bus.daemon = daemons.Daemon(bus, feet, session, config_file)
        daemon.run()
        rows = accounts(bus, daemon)
    finally:
        session.close()
        bus.close()
    assert bus.clock_ns() >= end_ns, "the source's clock is the injected one, whatever time the host took"
    assert [(name, counted) for name, _, counted in rows] == [(name, injected) for name, injected, _ in rows], (
        day.happened
    )
    injected_of = {name: injected for name, injected, _ in rows}
    assert injected_of["used"] > 150 * SECONDS
    assert sum(injected_of.values()) > injected_of["used"] + injected_of["all that came in"], (
        "some were refused or dropped"
    )
    assert len(day.happened) >= 8, day.happened
    assert numbers == list(range(len(numbers)))
    assert healths[-1].cycles["published"] <= len(numbers) <= healths[-1].cycles["published"] + 5
