"""The doctor where the kernel has CAN: `insole run` on vcan, and boards that obey on the same bus."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from insole_daemon import config as configs
from insole_daemon.bus.opening import open_bus
from insole_daemon.config import Bus
from insole_daemon.service.doctor import can
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.load import Unloaded

pytestmark = pytest.mark.vcan

INSOLE = Path(sys.executable).with_name("insole")
CONFIG = """
format: insole-config/1
rig: vcan
buses: [socketcan:{vcan}]
insoles:
  - {{foot: left, boards: [{boards}]}}
boards: {{configure: true}}
publish: {{slack_ms: 1000, stale_after_ms: 5000}}
zenoh: {{listen: [{endpoint}]}}
"""


def insole(*arguments: object) -> subprocess.CompletedProcess[str]:
    done = subprocess.run([INSOLE, *map(str, arguments)], capture_output=True, text=True, timeout=120)
    assert "Traceback" not in done.stderr
    return done


@pytest.fixture
def config(vcan: str, endpoint: str, tmp_path: Path) -> Path:
    boards = ", ".join(f"{{address: {address}, interface: {vcan}, period_ms: 50}}" for address in (5, 6, 7))
    file = tmp_path / "config.yaml"
    file.write_text(CONFIG.format(vcan=vcan, boards=boards, endpoint=endpoint))
    return file


@contextlib.contextmanager
def running(config: Path) -> Iterator[None]:
    """`insole run`, and an MTB3 and two MTB4 that were just powered."""
    settings = configs.load(config)
    layouts = [load_layout(insole_of) for insole_of in settings.insoles]
    emulator = Emulator(
        settings, layouts, Unloaded(layouts), streaming=False, generation={5: "mtb3", 6: "mtb4", 7: "mtb4"}
    )
    source, stop = open_bus(settings.buses[0]), threading.Event()

    def receive():
        source.receive()
        return source.drain()

    boards = threading.Thread(target=emulator.play, args=(source.sink(1.0).send, stop, None, receive))
    process = subprocess.Popen([INSOLE, "run", "--config", config], stderr=subprocess.PIPE, text=True)
    try:
        assert process.stderr is not None
        assert "reading socketcan:" in process.stderr.readline()
        boards.start()
        yield
    finally:
        process.terminate()
        process.communicate(timeout=10)
        stop.set()
        boards.join()
        source.close()


@pytest.mark.timeout(300)
def test_from_silent_boards_to_none_with_a_problem(config: Path, endpoint: str, vcan: str) -> None:
    done, output = doctor(config)
    assert done.returncode == 0, output
    assert "CAN and raw CAN sockets are there" in output
    assert f"{vcan} is up (virtual, vcan)" in output
    assert "free" in output
    assert "runs: boards, their versions and the bus cannot be looked at" in output
    with running(config):
        done, output = doctor(config)
        assert done.returncode == 1
        assert "board 5 MTB with firmware 2.17.0; never seen" in output
        assert "→ insole boards configure --foot left" in output
        configured = insole("boards", "configure", "--foot", "left", "--connect", endpoint)
        assert configured.returncode == 0, configured.stdout + configured.stderr
        done, output = doctor(config)
        assert done.returncode == 0, output
        assert "board 6 MTB4 with firmware 1.25.0, sends " in output


def doctor(config: Path) -> tuple[subprocess.CompletedProcess[str], str]:
    """What `insole doctor` did and said, its folded lines and columns as one."""
    done = insole("doctor", "--config", config)
    return done, " ".join(done.stdout.split())


def test_an_interface_that_is_down(vcan: str, monkeypatch: pytest.MonkeyPatch) -> None:
    subprocess.run(["ip", "link", "add", "dev", "vcan7", "type", "vcan"], check=True)
    try:
        (finding,) = can.check_interface(Bus("socketcan", "vcan7"), True)
        assert (finding.level, finding.remedy) == ("problem", "sudo ip link set vcan7 up")
        subprocess.run(finding.remedy.removeprefix("sudo ").split(), check=True)
        (finding,) = can.check_interface(Bus("socketcan", "vcan7"), True)
        assert finding.level == "ok"
        monkeypatch.setattr(can.shutil, "which", lambda *_, **__: None)  # a host without iproute2
        (finding,) = can.check_interface(Bus("socketcan", "vcan7"), True)
        assert (finding.level, finding.remedy) == ("warning", "sudo apt install iproute2")
    finally:
        subprocess.run(["ip", "link", "delete", "vcan7"], check=True)
