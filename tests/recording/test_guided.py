"""Guided recording: coverage is determined from the load, with and without a reference."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import yaml

import insole_daemon
from insole_daemon import config as configs
from insole_daemon.cli.record import insoles_of
from insole_daemon.recording.coverage import Protocol, compute_coverage
from insole_daemon.recording.guide import Guide
from insole_daemon.recording.instrument import Instrument
from insole_daemon.simulation.conditions import ChamberCycles
from insole_daemon.simulation.foot import Walk
from insole_daemon.simulation.scenarios.chamber import Chamber, programme
from insole_daemon.skin import layout as layouts

from ..conftest import RunningDaemon
from ..ports import free_port

RECORDER = Path(__file__).with_name("recorder_process.py")
INSOLE = Path(sys.executable).with_name("insole")
CHAMBER = Protocol(steps=0)


def played(turns, hz=5.0, noise=0.0):
    turns = np.array(turns, float)
    t_s = np.arange(0.0, turns[-1, 0], 1 / hz)
    load = np.interp(t_s, turns[:, 0], turns[:, 1])
    return t_s, load + np.random.default_rng(0).normal(0.0, noise, len(t_s))


def done(items):
    return [item.name for item in items if item.done >= 1.0]


def test_the_simulated_chamber_covers_the_whole_protocol():
    turns = programme(300e3, (5e3, 50e3), ChamberCycles(cycles=2, hold_s=62.0))
    items = compute_coverage(*played(turns, noise=300.0), CHAMBER)
    assert done(items) == ["rest", "slow", "fast", "hold", "recovery", "minor loops"]
    assert next(item.seen for item in items if item.name == "minor loops") == "2"


@pytest.mark.parametrize(
    ("turns", "covered"),
    [
        ([(0, 0), (60, 0)], []),
        ([(0, 0), (6, 0), (30, 1e5), (54, 0), (60, 0)], ["rest", "slow"]),
        ([(0, 0), (2, 0), (32, 1e5), (62, 0)], ["slow"]),
        ([(0, 0), (6, 0), (30, 1e5), (95, 1e5), (119, 0), (125, 0)], ["rest", "slow", "hold"]),
        ([(0, 0), (6, 0), (30, 1e5), (54, 0), (57, 1e5), (60, 0), (70, 0)], ["rest", "slow", "fast"]),
        ([(0, 0), (6, 0), (30, 1e5), (54, 0), (57, 1e5), (80, 0), (90, 0)], ["rest", "slow"]),
        ([(0, 0), (6, 0), (16, 1e5), (20, 5e4), (24, 1e5), (28, 5e4), (32, 1e5), (40, 0)], ["rest"]),
    ],
    ids=["nothing", "one ramp", "no rest", "no recovery", "two speeds", "fast one way", "loops at the top"],
)  # fmt: skip
def test_missing_phases_are_reported(turns, covered):
    items = compute_coverage(*played(turns), CHAMBER)
    assert done(items) == covered
    assert all(item.ask for item in items)


def test_steps_are_counted_and_a_hold_is_not_one():
    layout = layouts.builtin("left", (5, 6, 7))
    t_s = np.arange(0.0, 30.0, 0.1)
    walk = Walk([layout]).pressure_pa("left", t_s).mean(axis=(1, 2))
    items = {item.name: item for item in compute_coverage(t_s, walk, Protocol())}
    assert items["walking"].done == 1.0
    assert items["hold"].done < 0.1


def test_a_reference_takes_precedence_over_counts(tmp_path):
    config = tmp_path / "config.yaml"
    config.write_text("format: insole-config/1\n")
    guide = Guide(insoles_of(configs.load(config))[:1], "chamber", CHAMBER)
    instrument = Instrument("left", "chamber")
    instrument.take_line("temperature_c,pressure_pa", 0.0)
    t_s, load = played([(0, 0), (6, 0), (30, 1e5), (54, 0), (60, 0)])
    for at, pressure_pa in zip(t_s.tolist(), load.tolist(), strict=True):
        guide.add_reference(instrument, instrument.take_line(f"20.0,{pressure_pa}", 1e9 + at), 1e9 + at)
    guide.add_reference(instrument, instrument.take_line("20.0,", 1e9 + 61), 1e9 + 61)  # a value that is missing
    summary = guide.summary(guide.coverage_by_foot())["left"]
    assert summary["load_from"] == "reference"
    assert summary["missing"] == ["fast", "hold", "recovery", "minor loops"]


def test_a_chamber_without_a_gauge_is_covered_by_its_counts(tmp_path):
    """Emulated boards play a chamber to a recorder in another process."""
    # rest, slow up and down, pause, fast up and down, pause, up, hold, down, recovery, up, loops, top
    seconds, parts = [1.3, 3, 3, 0.5, 0.6, 0.6, 0.5, 0.8, 2.5, 0.8, 2.5, 0.8, 0.7, 0.7, 0.7, 0.8, 0.8, 1.0], [
        0, 1, 0, 0, 1, 0, 0, 1, 1, 0, 0, 0.6, 0.3, 0.6, 0.3, 1.0, 0, 0,
    ]  # fmt: skip
    turns = np.array([(0.0, 0.0), *zip(np.cumsum(seconds).tolist(), [200e3 * part for part in parts], strict=True)])
    config, out = tmp_path / "config.yaml", tmp_path / "trial"
    config.write_text("format: insole-config/1\n")
    port = free_port(socket.SOCK_DGRAM)
    process = subprocess.Popen(
        [sys.executable, RECORDER, out, config, str(port), "0", "guided"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    limit = threading.Timer(60.0, process.kill)  # it says nothing more once the chamber has come to its end
    limit.start()
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    coverages = []
    with RunningDaemon(config, "", port).boards(load=lambda of: Chamber(of, turns)):
        for line in process.stdout:
            coverages.append(
                {foot: {item["name"]: item["done"] for item in items} for foot, items in json.loads(line).items()}
            )
            if all(value == 1.0 for items in coverages[-1].values() for value in items.values()):
                break
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate()
    limit.cancel()
    assert process.returncode == 0, errors
    assert set(coverages[-1]) == {"left", "right"}
    assert list(coverages[-1]["left"]) == ["rest", "slow", "fast", "hold", "recovery", "minor loops"]
    slow = [covered["left"]["slow"] for covered in coverages]
    assert slow[0] < 1.0
    assert "insole: left: hold it steadily for 2 s, at 60% of the top or more" in errors
    assert "insole: left: all is covered: Ctrl-C ends" in errors
    assert "insole: right: missing: nothing" in errors
    stored = yaml.safe_load((out / "recording.yaml").read_text())["extensions"]["coverage"]
    assert stored["left"]["missing"] == []
    assert stored["left"]["load_from"] == "counts"
    assert insole_daemon.load(out)["left"].counts.any()


def test_guided_recording_over_the_network_reports_missing_phases(daemon, tmp_path):
    out = tmp_path / "walk"
    with daemon.boards():
        ended = subprocess.run(
            [INSOLE, "record", out, "--remote", "--connect", daemon.endpoint, "--foot", "left", "--guided",
             "--seconds", "3"],
            capture_output=True, text=True,
        )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    lines = [json.loads(line) for line in ended.stdout.splitlines()]
    assert [item["name"] for item in lines[-1]["left"]][-1] == "walking"
    assert "left: missing: rest" in ended.stderr
    assert "hold (" in ended.stderr
    stored = yaml.safe_load((out / "recording.yaml").read_text())["extensions"]["coverage"]["left"]
    assert "walking" in stored["missing"]
    assert len(insole_daemon.load(out)["left"].t_ns) > 50
