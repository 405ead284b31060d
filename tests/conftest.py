"""What tests of several folders share: marks, and a real daemon in a process of its own."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from insole_daemon import config as configs
from insole_daemon.bus.sink import can_frames
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.foot import Walk
from insole_daemon.simulation.load import Load
from insole_daemon.skin.layout import Layout

from .ports import free_port

DAEMON = Path(__file__).parent / "service" / "daemon_process.py"
LONG = Path(__file__).with_name("long.txt")
LISTED = tuple(line for line in LONG.read_text().splitlines() if line and not line.startswith("#"))
HANGING_S = 1800  # a long test that takes so much hangs: what it takes otherwise depends on who else uses the machine
PATIENCE_S = 100.0  # for what happens in milliseconds, if nobody else uses the machine

os.environ.pop("COLUMNS", None)  # set for pytest-xdist's workers: output would be folded


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files of which the two test commands would deselect all tests: to import them takes up to 15 s."""
    if not collection_path.name.startswith("test_"):
        return None
    file = collection_path.relative_to(config.rootpath).as_posix()
    if config.option.markexpr == "not long and not vcan":
        return True if file in LISTED else None
    if config.option.markexpr == "long":
        has_long = any(line.startswith(file) for line in LISTED) or "mark.long" in collection_path.read_text()
        return None if has_long else True
    return None


@pytest.hookimpl(tryfirst=True)  # before pytest deselects by marker
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that long.txt lists; long ones are stopped only if they hang."""
    for item in items:
        if item.nodeid.startswith(LISTED):
            item.add_marker("long")
        if item.get_closest_marker("long"):
            item.add_marker(pytest.mark.timeout(HANGING_S))


@dataclass
class RunningDaemon:
    """A daemon process, its Zenoh endpoint, and boards that can be played to it."""

    config_file: Path
    endpoint: str
    port: int
    process: subprocess.Popen[str] | None = None
    environment: dict[str, str] | None = None

    def start(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, str(DAEMON), str(self.config_file), str(self.port)],
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **(self.environment or {})},
        )
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"

    def end(self) -> tuple[int, float]:
        """(exit status, seconds it took) of a SIGTERM."""
        assert self.process is not None
        began = time.monotonic()
        self.process.terminate()
        status = self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()
        return status, time.monotonic() - began

    @contextlib.contextmanager
    def boards(
        self, period_ms: int = 20, load: Callable[[Sequence[Layout]], Load] = Walk, **further: Any
    ) -> Iterator[Emulator]:
        """Emulated boards of both feet under `load`, until the block ends; `further` as for an Emulator."""
        config = configs.load(self.config_file)
        config = replace(
            config,
            insoles=tuple(
                replace(insole, boards=tuple(replace(board, period_ms=period_ms) for board in insole.boards))
                for insole in config.insoles
            ),
        )
        layouts = [load_layout(insole) for insole in config.insoles]
        with self.played(Emulator(config, layouts, load(layouts), **further)) as emulator:
            yield emulator

    @contextlib.contextmanager
    def played(self, emulator: Emulator) -> Iterator[Emulator]:
        """What `emulator` sends, until the block ends."""
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.connect(("127.0.0.1", self.port))

        def send(batch):
            for row in can_frames(batch):
                with contextlib.suppress(ConnectionRefusedError):  # nobody listens while the daemon restarts
                    sock.send(row.tobytes())

        stop = threading.Event()
        thread = threading.Thread(target=emulator.play, args=(send, stop))
        thread.start()
        try:
            yield emulator
        finally:
            stop.set()
            thread.join()
            sock.close()


@pytest.fixture(autouse=True, scope="session")
def _state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """No test reads or writes what a daemon of this user keeps."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STATE_DIRECTORY", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture
def endpoint() -> str:
    """A Zenoh endpoint on loopback that nobody listens on."""
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def daemon(tmp_path: Path, endpoint: str) -> Iterator[RunningDaemon]:
    """A daemon of both feet on free ports; it runs when the test begins and is ended after it."""
    config_file = tmp_path / "config.yaml"
    config_file.write_text(f"format: insole-config/1\nrig: test\nzenoh:\n  listen: [{endpoint}]\n")
    running = RunningDaemon(config_file, endpoint, free_port(socket.SOCK_DGRAM))
    running.start()
    yield running
    running.end()
