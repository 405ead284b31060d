"""Loss of data if `insole record` is killed at random moments.

    python -m benchmarks.endurance.killed_recorders                # 200 of them, four at a time: some ten minutes
    python -m benchmarks.endurance.killed_recorders --kills 8

Three of four recorders read a bus, some of these with a new folder every 100 kB; the fourth is `insole record --remote`
and reads the cycles of a daemon. Every folder must open as a recording. Its frames must be the first that were sent,
without a gap, and its last line must be complete. Recorders and daemon have priority over other programs of the host.

Takes about 10 minutes.
"""

from __future__ import annotations

import argparse
import os
import socket
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import insole_daemon
from benchmarks.lib import measured, traffic
from benchmarks.lib.process import Child
from benchmarks.lib.quota import Group
from insole_daemon.bus.candump import read
from insole_daemon.errors import InsoleError

_AT_ONCE = 4
_LONGEST_S = 4.0
_PERIOD_S = 0.02
_RECORDER = Path(__file__).parents[2] / "tests" / "recording" / "recorder_process.py"
_ROTATE_BYTES = 100_000


@dataclass
class Killed:
    """What one recorder left."""

    of: str  # what it recorded
    missing_s: list[float] = field(default_factory=list)  # of what had been sent, a stream each
    folders: int = 0
    torn: int = 0  # files whose last line is half a line
    broken: list[str] = field(default_factory=list)


class Victim:
    """A recorder that is killed `after_s` seconds after it has begun."""

    RECORDS: ClassVar[str]

    def __init__(self, folder: Path, after_s: float, arguments: list[str]) -> None:
        self.out = folder / "trial"
        self._after_s = after_s
        self._kill_at: float | None = None
        self.killed_ns = 0
        self.did_not_begin = False
        self._stderr = folder / "stderr.txt"
        with open(self._stderr, "wb") as stderr:
            self._process = subprocess.Popen(
                [sys.executable, *arguments], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=stderr
            )
        self._group = Group(self._process.pid)

    def tick(self, now: float) -> None:
        """Kill it if it is time."""
        if self._kill_at is None:
            if not self.begun():
                return
            self._kill_at = now + self._after_s
        if self.killed_ns == 0 and now >= self._kill_at:
            self._process.kill()
            self.killed_ns = time.time_ns()
            self._process.wait()
            self._group.close()
            assert self._process.stdin is not None
            self._process.stdin.close()
        elif self.killed_ns == 0:
            self.feed()

    def begun(self) -> bool:
        """Whether it records."""
        if self._process.poll() is not None:
            print(f"a recorder did not begin: {self._stderr.read_text()}", file=sys.stderr)
            self.did_not_begin = True
        return (self.out / "recording.yaml").exists()

    def feed(self) -> None:
        """What comes in 20 ms."""

    def folders(self) -> list[Path]:
        """All that it left, in order."""
        found = [path for path in self.out.parent.iterdir() if path.is_dir() and not path.name.startswith(".")]
        return sorted(found, key=lambda path: int(path.name.partition("-")[2] or 0))

    def left(self) -> Killed:
        """What is on the disk."""
        left = Killed(self.RECORDS)
        for folder in self.folders():
            left.folders += 1
            try:
                self.look(folder, insole_daemon.load(folder), left)
            except InsoleError as error:
                left.broken.append(f"{folder.name}: {error}")
        return left

    def look(self, folder: Path, trial: Any, left: Killed) -> None:
        raise NotImplementedError


class BusVictim(Victim):
    """Fed with frames, and with the readings of a chamber on its standard input."""

    RECORDS = "a bus"

    def __init__(self, folder: Path, after_s: float, loop: traffic.Loop, rotate_bytes: int) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        config = folder / "config.yaml"
        config.write_text("format: insole-config/1\n")
        super().__init__(
            folder, after_s, [str(_RECORDER), str(folder / "trial"), str(config), str(port), str(rotate_bytes)]
        )
        self._frames = [row.tobytes() for row in loop.rows]
        self._rows = loop.rows
        self._sent: list[float] = []
        self._found = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._say("pressure_pa")

    def _say(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n".encode())
        self._process.stdin.flush()

    def feed(self) -> None:
        now = time.time()
        for frame in self._frames[len(self._sent) : len(self._sent) + 112]:
            self._socket.send(frame)
            self._sent.append(now)
        self._say(str(len(self._sent)))

    def look(self, folder: Path, trial: Any, left: Killed) -> None:
        text = (folder / "can.log").read_bytes()
        left.torn += not text.endswith(b"\n") and bool(text)
        reference = folder / "reference.csv"
        left.torn += reference.exists() and not reference.read_bytes().endswith(b"\n")
        if not text:
            return
        frames = read(folder / "can.log").frames
        sent = self._rows[self._found : self._found + len(frames)]
        if not (np.array_equal(sent.view(np.uint32)[:, 0], frames.can_id) and np.array_equal(sent[:, 8:], frames.data)):
            left.broken.append(f"{folder.name}: other frames than were sent")
        self._found += len(frames)

    def left(self) -> Killed:
        self._socket.close()
        left = super().left()
        all_there = self._found == len(self._sent)
        left.missing_s.append(0.0 if all_there else self.killed_ns * 1e-9 - self._sent[self._found])
        return left


class RemoteVictim(Victim):
    """Takes what a daemon publishes."""

    RECORDS = "a daemon"

    def __init__(self, folder: Path, after_s: float, endpoint: str) -> None:
        command = ["-m", "insole_daemon", "record", str(folder / "trial"), "--remote", "--connect", endpoint]
        super().__init__(folder, after_s, command)

    def look(self, folder: Path, trial: Any, left: Killed) -> None:
        for foot in trial.feet:
            if len(foot):
                left.missing_s.append((self.killed_ns - int(foot.t_ns[-1])) * 1e-9)


def group(victims: list[Victim]) -> None:
    """Let them record, and kill each at its moment."""
    due = time.monotonic()
    while not all(victim.killed_ns or victim.did_not_begin for victim in victims):
        for victim in victims:
            if not victim.did_not_begin:
                victim.tick(time.monotonic())
        due = max(due + _PERIOD_S, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    random = np.random.default_rng(options.seed)
    loop = traffic.loop(options.seed)
    killed: list[Killed] = []
    with (
        tempfile.TemporaryDirectory() as root,
        Child("lib.timed_daemon", seconds=1e6, endpoint=measured.free_endpoint()) as daemon,
        Group(daemon.pid),
    ):
        ready = daemon.report()
        with Child("lib.feeder", to=ready["feeds"][0], seconds=86_400):
            number = 0
            while len(killed) < options.kills:
                victims: list[Victim] = []
                for _ in range(min(_AT_ONCE, options.kills - len(killed))):
                    number += 1
                    folder = Path(root, str(number))
                    folder.mkdir()
                    after_s = float(random.uniform(0, _LONGEST_S))
                    if number % 4 == 3:
                        victims.append(RemoteVictim(folder, after_s, ready["endpoint"]))
                    else:
                        victims.append(BusVictim(folder, after_s, loop, _ROTATE_BYTES if number % 2 else 0))
                group(victims)
                killed += [victim.left() for victim in victims if victim.killed_ns]
                print(f"{len(killed)} killed, load {os.getloadavg()[0]:.1f}", file=sys.stderr, flush=True)
    print(f"{len(killed)} recorders killed, which left {sum(each.folders for each in killed)} folders; ", end="")
    print(f"{number - len(killed)} more did not begin")
    for each in killed:
        for text in each.broken:
            print(f"does not open: {text}")
    print(f"folders that do not open or hold something else: {sum(len(each.broken) for each in killed)} (wanted 0)")
    print(f"last lines that are torn: {sum(each.torn for each in killed)} (wanted 0)")
    for of in (BusVictim.RECORDS, RemoteVictim.RECORDS):
        missing_ms = [1e3 * seconds for each in killed if each.of == of for seconds in each.missing_s]
        p50, p99, most = np.percentile(missing_ms, [50, 99, 100])
        print(f"missing at the end of {of}: {p50:.0f} ms p50, {p99:.0f} ms p99, {most:.0f} ms at most (wanted 1000)")


if __name__ == "__main__":
    main()
