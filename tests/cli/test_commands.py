"""The commands as a person runs them: processes, their output, their exit status."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.ports import free_port

INSOLE = Path(sys.executable).with_name("insole")


def insole(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([INSOLE, *map(str, arguments)], capture_output=True, text=True, stdin=subprocess.DEVNULL)


def test_help_names_every_verb_and_the_exit_status():
    done = insole("--help")
    assert done.returncode == 0
    for verb in (
        "demo",
        "run",
        "simulate",
        "replay",
        "watch",
        "status",
        "doctor",
        "boards",
        "zero",
        "map",
        "record",
        "import",
        "export",
    ):
        assert re.search(rf"^  {verb} +\w.*\.$", done.stdout, re.MULTILINE), f"{verb} is explained on one line"
    assert "Exit status" in done.stdout


def test_version_and_completion_are_printed():
    import insole_daemon

    assert insole("--version").stdout == f"insole-daemon {insole_daemon.__version__}\n"
    asked = {"_INSOLE_COMPLETE": "complete_bash", "COMP_WORDS": "insole sta", "COMP_CWORD": "1"}
    done = subprocess.run([INSOLE], capture_output=True, text=True, env={**os.environ, **asked}, check=True)
    assert done.stdout.split() == ["status"]


def test_help_loads_nothing_heavy():
    heavy = ("numpy", "zenoh", "can", "rich", "asyncio", "ssl", "hashlib", "tempfile", "webbrowser")
    code = f"import sys, insole_daemon.cli; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.fixture(scope="module")
def demo():
    """The endpoint of an `insole demo` without a terminal that runs as long as the tests that look at it."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    command = [INSOLE, "demo", "--listen", endpoint]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    first = process.stdout.readline()
    if not first:
        pytest.fail(f"insole demo: {process.stderr.read()}")
    time.sleep(2)
    yield endpoint
    process.send_signal(signal.SIGINT)
    rest, errors = process.communicate()
    assert process.returncode == 0, errors
    assert re.search(r"left: \d+ cycles seen, \d+ lost", errors)
    assert "insole: next: " in errors
    assert re.search(r"left +f_z +-?\d+ N +m_x .* CoP .* [45]\d\.\d Hz +age \d+ ms +lost \d+", rest)


def test_status_in_one_screen(demo):
    done = insole("status", "--connect", demo)
    assert done.returncode == 0, done.stderr
    # A busy host's boards are silent at times, which takes lines of its own.
    assert len([line for line in done.stdout.splitlines() if not re.match(r"  wrong |   ", line)]) < 24
    assert re.search(r"demo left: (ok|degraded), \d+\.\d Hz", done.stdout)
    assert re.search(r"board 5 +\w+: sends \d+\.\d Hz, new values \d+\.\d Hz", done.stdout)
    assert "built-in default" in done.stdout
    assert re.search(r"bus +demo up, \d+ frames", done.stdout)


@pytest.mark.parametrize("verb", ["status", "boards", "model", "watch --count 8", "zero --no-wait --seconds 0.5"])
def test_it_fits_a_terminal_of_80_columns(verb, demo):
    command = f"stty columns 80; {INSOLE} {verb} --connect {demo}"
    done = subprocess.run(["script", "-qec", command, "/dev/null"], capture_output=True, text=True)
    assert done.returncode == (1 if "zero" in verb else 0), done.stdout  # of a foot that walks no zero is taken
    lines = re.sub(r"\x1b\[[\d;?]*[a-zA-Z]", "", done.stdout).splitlines()
    assert max(map(len, lines)) <= 80, done.stdout


def test_watch_prints_json_lines_that_parse(demo):
    done = insole("watch", "insole/demo/right/pressure", "--json", "--count", 3, "--connect", demo)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert [line["schema"] for line in lines] == ["insole.pressure/2"] * 3
    assert len(lines[0]["pressure_pa"]) == 28
    assert lines[0]["pressure_pa"][0][6] is None, "a thermal pad has no pressure"
    assert lines[1]["seq"] == lines[0]["seq"] + 1


@pytest.mark.parametrize(
    ("arguments", "command"),
    [
        (("status",), "insole (record walk-1 --remote|doctor)"),  # by how busy the host is
        (("boards",), "insole zero"),
        (("model",), "insole model static"),
        (("zero", "--no-wait", "--seconds", "0.5"), "insole zero, with the foot in the air"),  # somebody walks
        (("watch", "--count", "1"), "insole record walk-1 --remote"),
    ],
)
def test_a_command_ends_by_naming_the_next_one(arguments, command, demo):
    done = insole(*arguments, "--connect", demo)
    assert re.match(f"insole: next: {command}", done.stderr.splitlines()[-1]), done.stderr


def test_watch_prints_text_and_survives_a_reader_that_goes(demo):
    command = f"{INSOLE} watch 'insole/demo/left/wrench' --connect {demo} | head -n 2"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True)
    assert [line.split()[0] for line in done.stdout.splitlines()] == ["insole.wrench/2"] * 2
    assert "Traceback" not in done.stderr


def test_a_second_daemon_on_the_same_endpoint_gets_a_message(demo):
    done = insole("demo", "--seconds", 2, "--listen", demo)
    assert done.returncode == 3
    assert "already in use" in done.stderr
    assert "Stop it" in done.stderr
    assert "config" not in done.stderr, "the demo has none"
    assert "Traceback" not in done.stderr


def test_a_config_with_mistakes_is_refused_with_all_of_them(tmp_path):
    config = tmp_path / "config.yaml"
    config.write_text("format: insole-config/1\nrigg: x\npublish:\n  slack_s: 0.005\n")
    done = insole("run", "--config", config)
    assert done.returncode == 4
    assert "line 2" in done.stderr
    assert "rig" in done.stderr
    assert "slack_ms" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_missing_interface_is_reported(tmp_path):
    config = tmp_path / "config.yaml"
    config.write_text(
        "format: insole-config/1\nbuses: [socketcan:nocan7]\ninsoles:\n  - foot: left\n    boards:\n"
        + "".join(f"      - {{address: {a}, interface: nocan7}}\n" for a in (5, 6, 7))
    )
    done = insole("run", "--config", config)
    assert done.returncode == 3
    assert re.search(r"socketcan:nocan7: cannot be opened: .*(CAN|no such interface)", done.stderr)
    assert "Traceback" not in done.stderr


def test_status_and_watch_without_a_daemon_name_insole_run(endpoint):
    for verb in ("status", "watch"):
        done = insole(verb, "--connect", endpoint)
        assert done.returncode == 3
        assert "insole run" in done.stderr


@pytest.mark.parametrize("bus", ["vcan0", "socketcan:", ":can0"])
def test_a_bus_has_a_driver_and_a_channel(bus):
    done = insole("simulate", "--bus", bus)
    assert done.returncode == 2
    assert "socketcan:can0" in done.stderr


def test_a_log_that_is_none_is_refused(tmp_path):
    log = tmp_path / "log"
    log.write_bytes(bytes(range(256)))
    done = insole("replay", log, "--bus", "virtual:x")
    assert done.returncode == 4
    assert str(log) in done.stderr
    assert "Traceback" not in done.stderr


def test_replay_keeps_the_logs_timing(tmp_path):
    log = tmp_path / "log"
    log.write_text("".join(f"({i * 0.01:.6f}) can0 450#40F0F0F0F0F0F0F0\n" for i in range(101)) + "(1.0) can0 705#00\n")
    began = time.monotonic()
    done = insole("replay", log, "--bus", "virtual:x", "--speed", 2)
    took = time.monotonic() - began
    assert done.returncode == 0, done.stderr
    assert "101 frames sent; left out: 1 that may be commands to boards" in done.stderr
    assert took > 0.5
