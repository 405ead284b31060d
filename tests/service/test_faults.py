"""What is found wrong with the hardware in what the daemon publishes."""

from __future__ import annotations

import numpy as np

from insole_daemon.config import Config
from insole_daemon.service.foot import Foot, load_feet
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.faults import InjectedFault
from insole_daemon.simulation.foot import Stand
from insole_daemon.skin.cycles import Cycles
from insole_daemon.skin.reader import SkinReader
from insole_daemon.wire.messages import Event

START_NS = 1_700_000_000_000_000_000


def stand(faults: list[InjectedFault], seconds: float = 2.0) -> tuple[Foot, Cycles]:
    foot = load_feet(Config())[0]
    emulator = Emulator(
        Config(), [foot.layout], Stand([foot.layout]), faults=faults, generation="mtb4", status_bits=False
    )
    (closed,) = SkinReader([foot.layout], 20_000_000, 5_000_000).feed(emulator.frames(START_NS, seconds))
    return foot, Cycles.concatenate(closed, foot.n_triangles)


def test_a_loose_triangle_never_enters_pressure_and_wrench() -> None:
    triangle = load_feet(Config())[0].layout.triangles[11]
    fault = InjectedFault("loose", 1.0, None, triangle.board, triangle.triangle, chance=0.5)
    foot, cycles = stand([fault])
    events: list[Event] = []
    for at in range(len(cycles)):
        raw, pressure, wrench, _ = foot.messages(cycles, at)
        events += foot.fault_events()
        assert (raw.valid == pressure.valid).all()
        assert (raw.valid == wrench.valid).all()
        rails = bool(((cycles.counts[at, 11] == 0) | (cycles.counts[at, 11] == 255)).all())
        assert not (rails and raw.valid[11].any())
        assert 100 < (wrench.f_z_n or 0) < 400, "half of 63 kg; eleven saturated taxels would add 700 N"
    assert not raw.valid[11].any()
    assert np.delete(raw.valid, 11, axis=0).sum() == 270
    assert wrench.valid_fraction == 27 / 28
    assert wrench.f_z_std_n is not None
    assert wrench.f_z_std_n > 0
    (event,) = (event for event in events if event.kind == "triangle_loose")
    assert (event.boards, event.triangle, event.taxel) == ([triangle.board], triangle.triangle, None)
    (listed,) = foot.faults()
    assert listed == {
        "kind": "triangle_loose", "board": triangle.board, "triangle": triangle.triangle, "taxel": None,
        "since_ns": event.t_ns,
    }  # fmt: skip


def test_the_load_is_judged_without_loose_triangles() -> None:
    triangle = load_feet(Config())[0].layout.triangles[11]
    foot, cycles = stand([InjectedFault("loose", 1.0, None, triangle.board, triangle.triangle)])
    before, after = 40, len(cycles) - 1
    f_z_before, _ = foot.load(cycles, before)
    for at in range(len(cycles)):
        foot.messages(cycles, at)
        foot.fault_events()
    f_z_after, _ = foot.load(cycles, after)
    assert f_z_before is not None
    assert f_z_after is not None
    assert abs(f_z_after - f_z_before) < 60
