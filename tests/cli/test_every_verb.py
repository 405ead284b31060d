"""Every verb under every condition that a person meets: tested here or in another file, or with the reason why not."""

from __future__ import annotations

import contextlib
import re
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
import typer

from insole_daemon import cli
from insole_daemon.bus.opening import open_bus
from insole_daemon.config import Bus

from ..ports import free_port
from . import test_failures as failures
from .test_failures import INSOLE, NO_NETWORK, given, insole, not_ignoring_interrupts  # noqa: F401

VERBS = sorted(typer.main.get_command(cli.app).commands)
NO_FILE = {"demo": "reads no file", "prove": "reads no file"}
FILES = [*failures.ALL_FILES.values(), ("doctor",)]  # the doctor reports it as a problem: in test_failures too
INTERRUPTED_AT = {  # the file of which the opening is interrupted
    "report": (("report", "walk", "--out", "new.html"), "can.log"),
    "export": (("export", "walk", "new.csv"), "can.log"),
    "calibrate": (("calibrate", "chamber", "--out", "new.json"), "can.log"),
    "validate": (("validate", "walk", "--calibration", "walk/calibration.json", "--json", "new.json"), "can.log"),
    "diagnose": (("diagnose", "chamber", "--out", "new"), "can.log"),
    "simulate": (("simulate", "stand", "--seconds", "2", "--out", "new"), "can.log"),
    "study": (("study", "study"), "study.yaml"),
    "doctor": (("doctor", "--config", "left.yaml"), "left.yaml"),
    "import": (("import", "walk/can.log", "new", "--config", "left.yaml"), "can.log"),
    "reference": (("reference", "walk", "forces.csv", "--mapping", "mapping.yaml", "--force"), "forces.csv"),
}
ENDED = {  # what goes on until Ctrl-C, what it says when it does, and with which status it then ends
    "run": (("run", "--config", "{daemon}"), "reading", 0),
    "demo": (("demo", "--listen", "127.0.0.1:{port}"), "insole demo:", 0),
    "record": (("record", "new", "--config", "left.yaml", "--foot", "left"), "Ctrl-C ends", 0),
    "bring-up": (("bring-up", "--config", "left.yaml", "--foot", "left", "--out", "new"), "listening", 1),  # in vain
    "map": (("map", "--out", "new", "--config", "left.yaml", "--foot", "left"), "reading", 3),  # nothing is written
    "simulate": (("simulate", "--bus", "udp_multicast:{group}"), "on udp_multicast", 0),
    "replay": (("replay", "walk/can.log", "--bus", "udp_multicast:{group}", "--speed", "0.1"), None, 0),  # sends
    "watch": (("watch", "--connect", "{endpoint}"), "insole.health", 0),
    "view": (("view", "--connect", "{endpoint}", "--port", "{port}"), "the page is on", 0),
    "zero": (("zero", "--connect", "{endpoint}", "--seconds", "50", "--no-wait"), "taking", 130),
}
WRONG_FOOT = {
    "zero": ("zero", "--no-wait", "--foot", "right"),
    "boards": ("boards", "--foot", "right"),
    "model": ("model", "--foot", "right"),
    "record": ("record", "new", "--remote", "--foot", "right"),
}
TAKEN = ("run", "demo", "view")
AT_ONCE = "asks the daemon once and ends within a second"
NO_FOOT = "has no --foot"
NO_PORT = "opens no port"
WRITES_NOTHING = "writes no file"
# Verbs that a condition cannot meet, and why; every other verb has a test of it.
NOT_MET: Mapping[str, Mapping[str, str]] = {
    "missing file": NO_FILE,
    "folder": NO_FILE,
    "wrong format": NO_FILE,
    "wrong foot": dict.fromkeys(
        (
            "demo",
            "run",
            "simulate",
            "replay",
            "watch",
            "status",
            "doctor",
            "view",
            "report",
            "export",
            "prove",
            "study",
        ),
        NO_FOOT,
    ),
    "full disk": {
        **dict.fromkeys(("run", "replay", "watch", "status", "doctor", "boards", "model", "demo"), WRITES_NOTHING),
        "view": "what the page records is written as `insole record` does",
        "zero": "the daemon writes it: tests/service/test_zeroing.py",
        "map": "layouts: tests/cli/test_map.py",
        "calibrate": "tests/calibration/test_bad_input.py",
        "diagnose": "tests/diagnosis/test_report.py",
        "bring-up": "writes its recording as `insole record` does, and its report as `insole report`",
    },
    "taken port": {verb: NO_PORT for verb in VERBS if verb not in TAKEN},
    "interrupted": {**dict.fromkeys(("status", "boards", "model"), AT_ONCE), "prove": "tests/cli/test_prove.py"},
    "80 columns": {},
    "no terminal": {},
}
TESTED: Mapping[str, set[str]] = {
    **{condition: {words[0] for words in FILES} for condition in ("missing file", "folder", "wrong format")},
    "wrong foot": {words[0] for words in (*failures.WRONG_FOOT.values(), *WRONG_FOOT.values())},
    "full disk": {words[0] for words in failures.FULL_DISK.values()},
    "taken port": set(TAKEN),
    "interrupted": {*INTERRUPTED_AT, *ENDED},
    "80 columns": set(VERBS),
    "no terminal": {words[0] for words in FILES} | {*INTERRUPTED_AT, *ENDED} | {"prove"},
}


@pytest.mark.parametrize("condition", TESTED)
def test_every_verb_is_tested_under_every_condition_or_cannot_meet_it(condition):
    tested, not_met = TESTED[condition], NOT_MET[condition]
    assert tested | set(not_met) == set(VERBS), "a verb is missing, or one that is gone is listed"
    assert not tested & set(not_met)
    for reason in not_met.values():
        for file in re.findall(r"tests/\S+\.py", reason):
            assert (Path(__file__).parents[2] / file).exists()


@pytest.mark.parametrize("verb", VERBS)
def test_help_fits_80_columns(verb, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(sys, "argv", ["insole", verb, "--help"])
    with pytest.raises(SystemExit, match="0"):
        cli.main()
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80


class Interrupt:
    """Sends SIGINT to this process when a file of that name is opened, once."""

    name = ""

    @classmethod
    def watch(cls) -> None:
        """Audit hooks stay for ever: one is enough."""

        def hook(event, arguments):
            if cls.name and event == "open" and str(arguments[0]).endswith(cls.name):
                cls.name = ""
                signal.raise_signal(signal.SIGINT)

        sys.addaudithook(hook)


@pytest.fixture(scope="module")
def interrupt():
    Interrupt.watch()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield Interrupt
    Interrupt.name = ""
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("verb", INTERRUPTED_AT)
def test_ctrl_c_ends_a_computation_with_one_word_and_leaves_nothing(verb, interrupt, given, monkeypatch, capsys):  # noqa: F811
    monkeypatch.chdir(given)
    arguments, interrupt.name = INTERRUPTED_AT[verb]
    status, stderr = insole(monkeypatch, capsys, *arguments)
    assert interrupt.name == "", "the file was opened"
    assert status == 130, stderr
    assert stderr.splitlines()[-1] == "insole: interrupted"
    assert "Traceback" not in stderr
    assert not list(given.glob("*new*"))


@pytest.fixture(scope="module")
def daemon(given, tmp_path_factory):  # noqa: F811
    """A daemon of the left foot alone, whose boards are silent: its configuration and its endpoint."""
    folder = tmp_path_factory.mktemp("daemon")
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    config = folder / "config.yaml"
    config.write_text((given / "left.yaml").read_text() + f"zenoh: {{listen: [{endpoint}]}}\n")
    process = subprocess.Popen(
        [INSOLE, "run", "--config", config], stderr=subprocess.PIPE, text=True, preexec_fn=not_ignoring_interrupts
    )
    assert process.stderr is not None
    first_line = process.stderr.readline()
    assert "reading virtual:fails" in first_line, first_line + process.stderr.read()
    yield config, endpoint
    process.terminate()
    assert process.wait() == 0
    process.stderr.close()


@pytest.mark.parametrize("verb", WRONG_FOOT)
def test_a_foot_that_the_daemon_does_not_have_is_reported(verb, daemon, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    status, stderr = insole(monkeypatch, capsys, *WRONG_FOOT[verb], "--connect", daemon[1])
    assert status == NO_NETWORK
    assert "right" in stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("verb", ENDED)
def test_ctrl_c_ends_a_running_command_without_a_traceback(verb, daemon, given, tmp_path):  # noqa: F811
    arguments, begun, expected = ENDED[verb]
    config, endpoint = daemon
    own = tmp_path / "own.yaml"
    own.write_text(config.read_text().replace(endpoint, f"tcp/127.0.0.1:{free_port()}"))
    port = free_port()
    group = f"239.74.{port >> 8}.{port & 255}"
    words = [word.format(endpoint=endpoint, port=port, group=group, daemon=own) for word in arguments]
    with contextlib.closing(open_bus(Bus("udp_multicast", group))) as bus, subprocess.Popen(
        [INSOLE, *words], cwd=given, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
        text=True, preexec_fn=not_ignoring_interrupts,
    ) as process:  # fmt: skip
        output = ""
        try:
            while begun is None and not bus.receive():
                assert process.poll() is None, process.stdout.read()
                bus.wait(0.1)
            while begun is not None and begun not in output:
                output += process.stdout.readline() or pytest.fail(f"{verb} ended: {output}")
            process.send_signal(signal.SIGINT)
            output += process.communicate()[0]
        finally:
            process.kill()
            for made in given.glob("new*"):
                shutil.rmtree(made)
    assert process.returncode == expected, output
    assert "Traceback" not in output
    assert "\x1b" not in output


@pytest.mark.parametrize("verb", TAKEN)
def test_a_port_in_use_is_reported_with_a_remedy(verb, daemon, given, taken, monkeypatch, capsys):  # noqa: F811
    monkeypatch.chdir(given)
    arguments = {
        "run": ("--config", daemon[0]),
        "demo": ("--listen", f"127.0.0.1:{taken}"),
        "view": ("--connect", daemon[1], "--port", taken),
    }[verb]
    status, stderr = insole(monkeypatch, capsys, verb, *arguments)
    assert status == NO_NETWORK
    assert "already in use" in stderr
    assert {"run": "zenoh", "demo": "--listen", "view": f"--port {taken + 1}"}[verb] in stderr


@pytest.fixture
def taken():
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield listening.getsockname()[1]
