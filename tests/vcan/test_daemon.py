"""`insole run` as a process on the kernel's own vcan, canplayer in a second one, the subscriber in a third: here."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import insole_daemon
from insole_daemon.bus.candump_writer import CandumpWriter
from insole_daemon.config import Config
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.foot import Walk

pytestmark = pytest.mark.vcan

GOLDEN = Path(__file__).resolve().parents[2] / "protocol" / "golden"
INSOLE = Path(sys.executable).with_name("insole")
# Playing takes as long as it takes on the one slow CPU there may be: only the frames close a cycle, never the time.
CONFIG = """
format: insole-config/1
rig: vcan
buses: [socketcan:{vcan}]
insoles:
  - {{foot: left, boards: [{left}]}}
  - {{foot: right, boards: [{right}]}}
publish: {{slack_ms: 1000, stale_after_ms: 5000}}
zenoh: {{listen: [{endpoint}]}}
"""


@dataclass
class Running:
    endpoint: str
    process: subprocess.Popen[str]


@pytest.fixture
def run(vcan: str, endpoint: str, tmp_path: Path) -> Iterator[Running]:
    """`insole run` of both feet, ready to receive."""
    boards = [f"{{address: {address}, interface: {vcan}}}" for address in range(5, 11)]
    config = tmp_path / "config.yaml"
    config.write_text(
        CONFIG.format(vcan=vcan, endpoint=endpoint, left=", ".join(boards[:3]), right=", ".join(boards[3:]))
    )
    process = subprocess.Popen([INSOLE, "run", "--config", config], stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    assert "reading socketcan:" in process.stderr.readline()
    yield Running(endpoint, process)
    began = time.monotonic()
    process.terminate()
    errors = process.communicate(timeout=10)[1]
    assert process.returncode == 0, errors
    assert time.monotonic() - began < 5


def play(log: Path, vcan: str) -> None:
    subprocess.run(["canplayer", "-I", log, f"{vcan}=can0"], check=True, timeout=120)


@pytest.mark.timeout(300)
def test_every_published_value_is_the_golden_one(run: Running, vcan: str) -> None:
    golden = json.loads((GOLDEN / "walk.json").read_text())
    with insole_daemon.connect(run.endpoint) as insole:
        streams = {
            (foot["foot"], what): getattr(insole, what)(foot["foot"])
            for foot in golden["feet"]
            for what in ("raws", "pressures", "wrenches")
        }
        healths = insole.healths("left")
        time.sleep(0.5)
        play(GOLDEN / "walk.log", vcan)
        for foot in golden["feet"]:
            cycles = foot["cycles"]
            raws, pressures, wrenches = (
                list(itertools.islice(streams[foot["foot"], what], len(cycles)))
                for what in ("raws", "pressures", "wrenches")
            )
            for cycle, raw, pressure, wrench in zip(cycles, raws, pressures, wrenches, strict=True):
                assert raw.seq == pressure.seq == wrench.seq == cycle["seq"]
                assert raw.lost == pressure.lost == wrench.lost == 0
                assert raw.counts.tobytes().hex().upper() == "".join(cycle["counts"])
                assert raw.status.tolist() == cycle["status"]
                assert np.flatnonzero(raw.missing).tolist() == cycle["missing"]
                assert (raw.late, raw.repeated) == (cycle["late"], cycle["repeated"])
                valid = [sum(int(mark) << k for k, mark in enumerate(row)) for row in pressure.valid]
                assert valid == cycle["valid"]
                expected = np.array(cycle["pressure_kpa"], float) * 1e3  # null becomes NaN
                np.testing.assert_allclose(pressure.pressure_pa, expected, rtol=1e-6)
                for name in ("f_z_n", "m_x_nm", "m_y_nm", "cop_x_m", "cop_y_m", "contact_area_m2", "valid_fraction"):
                    expected = cycle[name] if cycle[name] is None else pytest.approx(cycle[name], rel=1e-6, abs=1e-9)
                    assert getattr(wrench, name) == expected, name
        frames = len((GOLDEN / "walk.log").read_text().splitlines())
        health = next(health for health in healths if health.bus["frames"] >= frames)
    assert health.bus["frames"] == frames
    assert health.bus["overflows"] == 0
    assert not any(health.refused[reason] for reason in health.refused)


@pytest.mark.timeout(300)
def test_ten_seconds_of_a_foot_lose_nothing(run: Running, vcan: str, tmp_path: Path) -> None:
    left = Config().insoles[0]
    layout = load_layout(left)
    frames = Emulator(Config(insoles=(left,)), [layout], Walk([layout])).frames(1_760_000_000_000_000_000, 10.0)
    with CandumpWriter(tmp_path / "walk.log", ("can0",)) as writer:
        writer.write(frames)
    with insole_daemon.connect(run.endpoint) as insole:
        wrenches, healths = insole.wrenches("left"), insole.healths("left")
        time.sleep(0.5)
        play(tmp_path / "walk.log", vcan)
        cycles = list(itertools.islice(wrenches, 495))
        health = next(health for health in healths if health.bus["frames"] >= len(frames))
    assert sum(wrench.lost for wrench in cycles) == 0
    assert (health.bus["frames"], health.bus["overflows"]) == (len(frames), 0)
    assert health.cycles["late"] <= 1, "only the end of the log closes a cycle by time"


@pytest.mark.timeout(300)
def test_replay_and_simulate_put_frames_on_the_bus(run: Running, vcan: str) -> None:
    with insole_daemon.connect(run.endpoint) as insole:
        raws = insole.raws("right")
        subprocess.run(
            [INSOLE, "replay", GOLDEN / "walk.log", "--bus", f"socketcan:{vcan}", "--speed", "0.5"],
            check=True,
            timeout=60,
        )
        golden = json.loads((GOLDEN / "walk.json").read_text())["feet"][1]["cycles"]
        cycles = list(itertools.islice(raws, len(golden)))
        assert [raw.counts.tobytes().hex().upper() for raw in cycles] == ["".join(cycle["counts"]) for cycle in golden]
        simulate = subprocess.Popen(
            [INSOLE, "simulate", "stand", "--bus", f"socketcan:{vcan}", "--seconds", "3"], stderr=subprocess.DEVNULL
        )
        # The first cycle may have new readings of a part of the boards only.
        standing = next(w for w in insole.wrenches("left") if w.f_z_n is not None and w.f_z_n > 150)
        assert simulate.wait(60) == 0
    assert standing.f_z_n < 500
