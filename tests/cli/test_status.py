"""`insole status`, and what other verbs do where one endpoint leads to several rigs."""

from __future__ import annotations

import errno
import re
import subprocess
import sys
import threading
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest

from insole_daemon.bus.socketcan import cannot_open
from insole_daemon.cli.status import _screen
from insole_daemon.config import Config
from insole_daemon.service.foot import load_feet
from insole_daemon.skin.quality import Quality
from insole_daemon.wire.messages import Health
from insole_daemon.wire.publisher import FootPublisher
from insole_daemon.wire.session import open_session

INSOLE = Path(sys.executable).with_name("insole")
META = load_feet(Config())[0].meta()
CAN0 = {"state": "up", "since_ns": 1, "reopened": 0, "error": None}


def insole(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([INSOLE, *map(str, arguments)], capture_output=True, text=True, stdin=subprocess.DEVNULL)


def health(state: str = "streaming", uptime_s: float = 3.0, interface: dict[str, object] = CAN0, **bus: int) -> Health:
    board = {"state": state, "rate_hz": 50.0, "change_rate_hz": 50.0, "age_ms": None, "missed": 0}
    counted = {"frames": 9, "overflows": 0, "error_frames": {}, "clock_steps": 0, "interfaces": {"can0": interface}}
    return Health(
        foot="left", t_ns=1, uptime_s=uptime_s, state="ok", cycles={"published": 3}, publish_rate_hz=50.0,
        quality=Quality(500, 500, 0, 0, 0).document(), latency_ms={"p50": None},
        boards=[{"address": a} | board for a in (5, 6, 7)], faults=[], bus=counted | bus,
        refused={"other": 0}, asked={},
    )  # fmt: skip


def wrong(screen: str) -> list[str]:
    return re.findall(r"^  wrong +(.*)$", screen, re.MULTILINE)


def test_a_missing_interface_is_listed_first_and_replaces_its_boards():
    error = str(cannot_open("can0", OSError(errno.ENODEV, "No such device")))
    missing = CAN0 | {"state": "missing", "error": error}
    screen = _screen("demo", "left", health("never seen", interface=missing, overflows=1), META)
    first, *others = wrong(screen)
    assert first.startswith("can0 is missing: socketcan:can0: cannot be opened: there is no such interface")
    assert "sudo ip link set can0 up type can bitrate 1000000" in first
    assert not any("powered" in other for other in others), "nobody can tell of boards that nobody can hear"
    assert re.search(r"^  bus +can0 missing, 9 frames", screen, re.MULTILINE)
    assert screen.index("  bus ") < screen.index("  board 5")


def test_an_interface_that_came_back_is_up_whatever_its_last_error():
    screen = _screen("demo", "left", health("silent", interface=CAN0 | {"reopened": 1, "error": "was gone"}), META)
    assert [re.sub(r"\d", "", line) for line in wrong(screen)] == [
        "board  is silent: is it powered, connected and started?"
    ] * 3
    assert re.search(r"^  bus +can0 up, ", screen, re.MULTILINE)


def test_status_reports_steps_of_the_clock():
    (only,) = wrong(_screen("demo", "left", health(clock_steps=2), META))
    assert "back in time 2 times" in only
    assert "timedatectl" in only
    assert wrong(_screen("demo", "left", health(), META)) == []


@pytest.fixture
def two_rigs(endpoint):
    """An endpoint that leads to the left foot of rigs a and b, a with another uptime than b."""
    stop = threading.Event()
    with ExitStack() as opened:
        session = opened.enter_context(open_session("peer", [endpoint]))
        feet = {rig: opened.enter_context(FootPublisher(session, rig, "left")) for rig in ("a", "b")}
        for rig, foot in feet.items():
            foot.publish_latched("meta", replace(META, rig=rig, version=f"of {rig}"))
            foot.announce()

        def publish():
            while not stop.wait(0.1):
                feet["a"].publish(health(uptime_s=11))
                feet["b"].publish(health(uptime_s=22))

        thread = threading.Thread(target=publish)
        thread.start()
        try:
            yield endpoint
        finally:
            stop.set()
            thread.join()


def test_each_rig_has_its_own_health_and_meta(two_rigs):
    done = insole("status", "--connect", two_rigs)
    assert done.returncode == 0, done.stderr
    assert re.findall(r"^(\w left): ok, .* up (\d+) s, version (.*)$", done.stdout, re.MULTILINE) == [
        ("a left", "11", "of a"),
        ("b left", "22", "of b"),
    ]


def test_one_rig_can_be_asked_for(two_rigs):
    done = insole("status", "--connect", two_rigs, "--rig", "b")
    assert done.returncode == 0, done.stderr
    assert re.findall(r"^(\w) left", done.stdout, re.MULTILINE) == ["b"]
    done = insole("status", "--connect", two_rigs, "--rig", "c")
    assert done.returncode == 3
    assert "no insole daemon of rig c" in done.stderr


@pytest.mark.parametrize("verb", ["zero", "boards"])
def test_commands_need_the_rig_if_there_are_several_wearers(two_rigs, verb):
    done = insole(verb, "--connect", two_rigs)
    assert done.returncode == 3
    assert "a and b have a left foot" in done.stderr
    assert "--rig a" in done.stderr
    assert "lift" not in done.stderr
    done = insole(verb, "--connect", two_rigs, "--rig", "a")
    assert "nobody answered for insole/a/left" in done.stderr, "the rig was taken; it has no desk here"
