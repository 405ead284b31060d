"""One run: `insole run` on two interfaces, numbered boards, a subscriber; a fault in the midst of it."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import insole_daemon
from insole_daemon import config as configs
from insole_daemon.service.foot_setup import load_layout

INSOLE = str(Path(sys.executable).with_name("insole"))
FEET = {"left": (5, 6, 7), "right": (8,)}
TRIANGLES = {"left": 3, "right": 1}  # of a board
INTERFACES = {"left": "insolea", "right": "insoleb"}
# As many frames as one slow processor can carry with boards, daemon and subscriber; of the left foot what the watch
# over faults needs at least.
LAYOUT = "format: insole-layout/1\nfoot: {foot}\ntaxel_area_mm2: 32.4\ntriangles:\n"
TRIANGLE = (
    "  - {{board: {board}, triangle: {t}, patch: {patch}, x_mm: {x}, y_mm: {y}, rotation_deg: 0, mirrored: false}}\n"
)
SETTLE_S, AFTER_S = 4.0, 4.0
PORT = 7447
NEAR, FAR = "10.9.0.1", "10.9.0.2"  # the daemon's address and the subscriber's, where they are on two hosts


def ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True)


class Rig:
    """Everything of one run, in `folder`."""

    def __init__(
        self,
        folder: Path,
        *,
        faults: Sequence[dict[str, object]] = (),
        pressure_pa: float = 30e3,
        lift_s: float = 1e9,
        obey: bool = False,
        feet: Sequence[str] = ("left",),
        further: str = "",
        zenoh: str = f"{{listen: [tcp/127.0.0.1:{PORT}]}}",
        environment: dict[str, str] | None = None,
        subscribe_to: str = f"tcp/127.0.0.1:{PORT}",
        subscribe_in: Sequence[str] = (),
    ) -> None:
        self.folder = folder
        self.began_ns = self.ended_ns = 0  # of the fault, monotonic
        self.endpoint = subscribe_to
        self.feet = tuple(feet)
        self._subscribe_in = subscribe_in
        self._boards_said = json.dumps(
            {"faults": list(faults), "pressure_pa": pressure_pa, "lift_s": lift_s, "obey": obey}
        )
        self._environment = {**os.environ, "STATE_DIRECTORY": str(folder), **(environment or {})}
        self._ends = contextlib.ExitStack()
        self._write(further, zenoh)
        config = configs.load(folder / "config.yaml")
        self.layouts = {insole.foot: load_layout(insole) for insole in config.insoles}

    def _write(self, further: str, zenoh: str) -> None:
        lines = [f"format: insole-config/1\nrig: matrix\nzenoh: {zenoh}"]
        # A half that the one processor there is brings 5 ms late is none that a bus lost.
        lines += ["publish: {slack_ms: 20}"] if "publish:" not in further else []
        lines += [further] if further else []
        lines += [f"buses: [{', '.join(f'socketcan:{name}' for name in self.interfaces)}]", "insoles:"]
        for foot in self.feet:
            addresses = FEET[foot]
            text = LAYOUT.format(foot=foot)
            for place, (board, patch) in enumerate(zip(addresses, ("front", "middle", "rear"), strict=False)):
                for t in range(TRIANGLES[foot]):
                    text += TRIANGLE.format(board=board, t=t, patch=patch, x=200 - 60 * place, y=20 * t - 20)
            (self.folder / f"{foot}.yaml").write_text(text)
            boards = ", ".join(f"{{address: {board}, interface: {INTERFACES[foot]}}}" for board in addresses)
            lines.append(f"  - foot: {foot}\n    layout: {foot}.yaml\n    boards: [{boards}]")
            if (self.folder / f"{foot}.json").exists():
                lines[-1] += f"\n    calibration: {foot}.json"
        (self.folder / "config.yaml").write_text("\n".join(lines) + "\n")

    def __enter__(self) -> Rig:
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.close()
        for name in self.interfaces:
            subprocess.run(["ip", "link", "del", name], capture_output=True, check=False)

    @property
    def interfaces(self) -> list[str]:
        """The buses of its feet."""
        return [INTERFACES[foot] for foot in self.feet]

    def start(self) -> None:
        """Everything; returns when all runs as it should and the fault may come."""
        for name in self.interfaces:
            ip("link", "add", "dev", name, "type", "vcan")
            ip("link", "set", name, "up")
        self.start_daemon()
        self.subscriber = self._process(
            [*self._subscribe_in, sys.executable, "-m", "benchmarks.faults.matrix.subscriber", self.endpoint,
             str(self.folder / "seen")]
        )  # fmt: skip
        self._wait_for(self.subscriber, "subscribed")
        self.boards = self._process(
            [sys.executable, "-m", "benchmarks.faults.matrix.boards", str(self.folder / "config.yaml"),
             str(self.folder / "sent.npz"), self._boards_said]
        )  # fmt: skip
        self.playing_ns = int(self._wait_for(self.boards, "playing").split()[1])
        self.sleep_until(SETTLE_S)

    def start_daemon(self) -> None:
        log = self._ends.enter_context((self.folder / "daemon.log").open("a"))
        self.daemon = subprocess.Popen(
            [INSOLE, "run", "--config", str(self.folder / "config.yaml")], stderr=log, env=self._environment
        )
        self._ends.callback(self._end, self.daemon)
        starts_before = self.log().count("insole: reading")
        began = time.monotonic()
        while self.log().count("insole: reading") == starts_before:
            assert self.daemon.poll() is None, self.log()
            assert time.monotonic() - began < 60, self.log()
            time.sleep(0.02)

    def log(self) -> str:
        return (self.folder / "daemon.log").read_text(errors="replace")

    def sleep_until(self, seconds: float) -> None:
        """Until so long after the boards were powered up."""
        time.sleep(max(0.0, self.playing_ns * 1e-9 + seconds - time.monotonic()))

    @contextlib.contextmanager
    def fault(self) -> Iterator[None]:
        """What is in the block is the fault."""
        self.began_ns = time.monotonic_ns()
        yield
        self.ended_ns = time.monotonic_ns()

    def scheduled(self, begin_s: float, end_s: float) -> None:
        """The fault is one of the boards' own; wait for its end."""
        self.began_ns, self.ended_ns = (self.playing_ns + round(at * 1e9) for at in (begin_s, end_s))
        self.sleep_until(end_s)

    def mangle(self, how: str, *feet: str) -> None:
        for foot in feet or self.feet:
            assert self.boards.stdin is not None
            self.boards.stdin.write(f"mangle {foot} {how}\n")
            self.boards.stdin.flush()
            self._wait_for(self.boards, "done")

    def request(self, foot: str, verb: str, **arguments: object) -> dict[str, object]:
        with insole_daemon.connect(f"tcp/127.0.0.1:{PORT}") as insole:
            return insole.request(foot, verb, **arguments)

    def finish(self, after_s: float = AFTER_S) -> None:
        """Look at what follows, then end boards and subscriber, which write what they saw."""
        time.sleep(max(0.0, self.ended_ns * 1e-9 + after_s - time.monotonic()))
        self.boards.communicate("end\n", timeout=60)
        self.subscriber.communicate(timeout=60)

    def _process(self, command: list[str]) -> subprocess.Popen[str]:
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self._ends.callback(self._end, process)
        return process

    @staticmethod
    def _wait_for(process: subprocess.Popen[str], word: str) -> str:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith(word), f"expected {word!r}, found {line!r}"
        return line

    @staticmethod
    def _end(process: subprocess.Popen[str]) -> None:
        if process.poll() is None:
            process.terminate()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
