"""`insole simulate`: recordings, and boards that obey."""

import subprocess
import sys
import threading
import time

import can
import pytest

import insole_daemon
from insole_daemon.cli import simulate as verb
from insole_daemon.config import Bus, Config
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.scenarios import SCENARIOS
from insole_daemon.simulation.trial import Trial

INSOLE = [sys.executable, "-m", "insole_daemon"]


def insole(*arguments):
    return subprocess.run([*INSOLE, *map(str, arguments)], capture_output=True, text=True, stdin=subprocess.DEVNULL)


def test_every_scenario_can_be_asked_for():
    assert {name.value for name in verb.ScenarioName} == set(SCENARIOS)


def test_a_recording_of_a_scenario(tmp_path):
    effects = tmp_path / "effects.yaml"
    effects.write_text(
        "format: insole-effects/1\neffects:\n"
        "  - {effect: delay, where: {scope: insole}, parameters: {delay_s: {value: 0.05, unit: s}}}\n"
    )
    trial = tmp_path / "trial.yaml"
    trial.write_text("format: insole-trial/1\nmass_kg: 54\n")
    done = insole(
        "simulate", "T4", "--out", tmp_path / "t4", "--effects", effects, "--trial", trial, "--seed", 3, "--seconds", 4
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
    recording = insole_daemon.load(tmp_path / "t4")
    assert recording.kind == "shoe"
    assert recording["left"].wrench.f_z_n.max() > 54 * 9.81 * 0.8
    again = insole("simulate", "t4", "--out", tmp_path / "t4")
    assert again.returncode == 4
    assert "is already there; choose another name, or replace it with --force" in again.stderr


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["t4"], 2, "expected one of --bus"),
        (["t4", "--bus", "virtual:x", "--out", "nowhere"], 2, "expected one of --bus"),
        (["t7", "--out", "nowhere"], 2, "'t7' is not one of"),
        (["t1", "--out", "nowhere", "--seconds", 61], 2, "t1: seconds: expected at most 60 s, which is how long"),
        (
            ["t1", "--out", "nowhere", "--trial", "light.yaml"],
            4,
            "mass_kg: expected a finite number from 20",
        ),
        (["vacuum", "--out", "nowhere", "--trial", "heavy.yaml"], 2, "vacuum: mass_kg: not used"),
        (["t1", "--out", "nowhere", "--effects", "missing.yaml"], 4, "missing.yaml"),
    ],
)
def test_wrong_usage_is_refused(tmp_path, monkeypatch, arguments, status, message):
    monkeypatch.chdir(tmp_path)
    for name, mass_kg in (("light", 1), ("heavy", 100)):
        (tmp_path / f"{name}.yaml").write_text(f"format: insole-trial/1\nmass_kg: {mass_kg}\n")
    done = insole("simulate", *arguments)
    assert done.returncode == status
    assert message in " ".join(done.stderr.replace("│", " ").split())
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "nowhere").exists()


def test_boards_on_a_bus_obey_commands(monkeypatch):
    monkeypatch.setattr(verb, "on_end", lambda stop: None)  # the signals are pytest's
    config = Config()
    layouts = [load_layout(insole) for insole in config.insoles]
    answers, late = [], []
    with can.Bus("boards-obey", interface="virtual") as host:

        def talk():
            host.recv(10)  # now they are there
            began = time.monotonic()
            host.send(can.Message(arbitration_id=0x70F, data=b"\xff", is_extended_id=False))
            host.send(can.Message(arbitration_id=0x205, data=b"\x07\x01", is_extended_id=False))
            while time.monotonic() < began + 0.9:
                message = host.recv(0.1)
                if message is None:
                    continue
                if message.arbitration_id >> 8 == 7:
                    answers.append(message.arbitration_id)
                elif time.monotonic() > began + 0.5:
                    late.append(message.arbitration_id >> 4 & 0xF)

        talker = threading.Thread(target=talk)
        talker.start()
        verb._play(Trial("walk", config, layouts), Bus("virtual", "boards-obey"), 1.5)
        talker.join()
    assert sorted(answers) == [0x700 | address << 4 for address in range(5, 11)], "discovery is answered"
    assert set(late) == {6, 7, 8, 9, 10}, "board 5 was told to stop"
