"""Growing recordings: a real recorder in another process is killed, rotated, and used over the network."""

from __future__ import annotations

import dataclasses
import errno
import itertools
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

import insole_daemon
from benchmarks.lib.quota import Group
from insole_daemon import config as configs
from insole_daemon.bus.candump import read
from insole_daemon.bus.frames import FrameBatch
from insole_daemon.bus.source import BusCounters
from insole_daemon.errors import InsoleError
from insole_daemon.recording.copies import layout_of_meta
from insole_daemon.recording.force_shoe import COLUMNS
from insole_daemon.recording.live import LiveRecorder
from insole_daemon.recording.recorder import Session
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.skin import layout as layouts
from insole_daemon.wire.session import open_session

from ..conftest import PATIENCE_S, RunningDaemon
from ..ports import free_port

RECORDER = Path(__file__).with_name("recorder_process.py")
INSOLE = Path(sys.executable).with_name("insole")


class Recorder:
    """The recorder's process, and boards that play to it."""

    def __init__(self, folder: Path, rotate_bytes: int = 0) -> None:
        self.out = folder / "trial"
        config = folder / "config.yaml"
        config.write_text("format: insole-config/1\n")
        port = free_port(socket.SOCK_DGRAM)
        self.boards = RunningDaemon(config, "", port).boards
        self.process = subprocess.Popen(
            [sys.executable, RECORDER, self.out, config, str(port), str(rotate_bytes)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"

    def say(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def end(self, number: int = signal.SIGTERM) -> int:
        self.process.send_signal(number)
        self.process.communicate()
        return self.process.returncode


def assert_no_half_is_lost(folder: Path) -> None:
    """All boards send at the same rate, so all identifiers stand in the log as often, but for both its ends.

    There they may differ by the 100 ms that the emulator works out at once: it may be ended in the midst of them.
    """
    log = read(folder / "can.log")
    assert log.counters.dropped == 0
    often = np.unique(log.frames.can_id, return_counts=True)[1]
    assert len(often) == 56
    assert often.min() >= often.max() - 6


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[Recorder]:
    running = Recorder(tmp_path)
    yield running
    if running.process.poll() is None:
        running.end()


def test_the_folder_is_a_recording_before_the_first_frame(recorder):
    text = (recorder.out / "recording.yaml").read_text()
    assert "kind: free" in text
    assert "can: can.log" in text
    recorder.end(signal.SIGKILL)
    assert "built-in approximation" in text
    trial = insole_daemon.load(recorder.out)
    assert [len(foot) for foot in trial.feet] == [0, 0]
    assert trial.warnings == (f"{recorder.out / 'can.log'}: no frame in it",)


def test_a_killed_recorder_leaves_all_frames_up_to_one_second_before(recorder):
    """The kill comes while the recorder keeps up; only frames not yet passed to the disk within a second may
    be lost.
    """
    recorder.say("pressure_pa,temperature_c")
    with recorder.boards():
        sent = 0
        while sent < 100 or time.time() - last_s(recorder.out / "can.log") > 0.3:
            recorder.say(f"{1000 + sent},")
            sent += 1
            assert sent < 1000, "it does not keep up"
            time.sleep(0.02)
        killed_ns = time.time_ns()
        assert recorder.end(signal.SIGKILL) == -signal.SIGKILL
    assert_no_half_is_lost(recorder.out)
    trial = insole_daemon.load(recorder.out)
    assert trial.kind == "chamber"
    assert trial.can_origin == "recorded"
    for foot in trial.feet:
        assert len(foot) > 60
        assert killed_ns - foot.t_ns[-1] < 1e9
    reference = trial["left"].reference
    assert reference is not None
    assert reference.clock == "can"
    assert len(reference) > sent - 50
    assert reference["pressure_pa"].tolist() == list(range(1000, 1000 + len(reference)))
    assert np.isnan(reference["temperature_c"]).all()
    assert abs(killed_ns * 1e-9 - reference.time_s[-1]) < 1


def last_s(log: Path) -> float:
    """Return the time of the last frame in a growing log, 0 if it is empty."""
    lines = log.read_bytes()[-200:].splitlines() if log.exists() else []
    times = [float(line[1 : line.index(b")")]) for line in lines if line.startswith(b"(") and b")" in line]
    return times[-1] if times else 0.0


def test_a_finished_recording_has_every_frame(recorder):
    with recorder.boards():
        time.sleep(1.0)
    time.sleep(0.2)
    assert recorder.end() == 0
    assert_no_half_is_lost(recorder.out)
    assert insole_daemon.load(recorder.out).warnings == ()


def test_rotation_continues_in_self_contained_folders(tmp_path):
    recorder = Recorder(tmp_path, rotate_bytes=80_000)
    recorder.say("pressure_pa")
    with recorder.boards():
        for reading in range(150):
            recorder.say(str(reading))
            time.sleep(0.02)
    assert recorder.end() == 0
    parts = [path for path in (tmp_path / "trial", *(tmp_path / f"trial-{i}" for i in range(2, 20))) if path.exists()]
    assert len(parts) >= 3
    trials = [insole_daemon.load(path) for path in parts[:-1]]
    assert all((path / "can.log").stat().st_size >= 80_000 for path in parts[:-1])
    ends = [(trial["left"].t_ns[0], trial["left"].t_ns[-1]) for trial in trials]
    assert all(after[0] >= before[1] for before, after in itertools.pairwise(ends))
    references = [trial["left"].reference for trial in trials]
    readings = [reading for reference in references if reference for reading in reference["pressure_pa"]]
    assert readings == list(range(len(readings)))


def test_recording_over_the_network_writes_the_same_cycles(daemon, tmp_path):
    out, shoe = tmp_path / "remote", tmp_path / "shoe.yaml"
    shoe.write_text(
        "format: insole-shoe/1\nfoot: left\n"
        "front: {x_mm: 190, y_mm: -5, z_mm: -20, reports: ground_on_foot}\n"
        "rear: {x_mm: 35, y_mm: 0, z_mm: -20, reports: ground_on_foot}\n"
    )
    readings = dict.fromkeys(COLUMNS, 0.0) | {"time_s": 1.0, "front_fz_n": 300, "rear_fz_n": 400}
    with daemon.boards(), insole_daemon.connect(daemon.endpoint) as insole:
        raws = insole.raws("left")
        process = subprocess.Popen(
            [INSOLE, "record", out, "--remote", "--connect", daemon.endpoint, "--kind", "shoe",
             "--reference", "left=lab/shoe", "--shoe", shoe, "--seconds", "2"],
            stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        with open_session("client", connect=[daemon.endpoint]) as session:
            stop = threading.Event()

            def walk() -> None:
                while not stop.wait(0.05):
                    session.put("lab/shoe", json.dumps(readings))

            published = {}

            def read() -> None:
                while not stop.is_set():
                    raw = next(raws)
                    published[raw.seq] = raw

            threads = [threading.Thread(target=target) for target in (walk, read)]
            for thread in threads:
                thread.start()
            errors = process.communicate()[1]
            stop.set()
            for thread in threads:
                thread.join()
    assert process.returncode == 0, errors
    # How good it is depends on what else the machine does; that what came is recorded does not.
    assert re.search(r"left: (good|usable|not usable): \d+ of \d+ cycles \(\d+\.\d %\)", errors)
    with np.load(out / "counts.npz") as archive:
        seqs, counts = archive["left_seq"], archive["left_counts"]
    assert np.diff(seqs).tolist() == [1] * (len(seqs) - 1)
    common = [(row, published[seq]) for row, seq in enumerate(seqs.tolist()) if seq in published]
    assert len(common) > 50
    trial = insole_daemon.load(out)
    left = trial["left"]
    for row, raw in common:
        np.testing.assert_array_equal(counts[row], raw.counts)
        np.testing.assert_array_equal(left.valid[row], raw.valid)
        assert left.t_ns[row] == raw.t_ns
    assert left.reference is not None
    assert left.reference.clock == "own"
    assert list(left.reference.columns) == ["fz_n", "mx_nm", "my_nm", *COLUMNS, "received_s"]
    assert left.reference["fz_n"].tolist() == [700.0] * len(left.reference)
    assert left.reference["mx_nm"][0] == pytest.approx(-0.005 * 300)
    assert left.reference["my_nm"][0] == pytest.approx(-0.19 * 300 - 0.035 * 400)
    assert left.calibration.builtin, "the daemon's built-in default, labelled as what it is"
    assert left.pressure_pa is not None
    assert left.wrench is not None
    assert any("built-in approximation" in line for line in trial.invented)
    assert any("built-in line" in line for line in trial.invented)
    layout = configs.Config().insoles[0]
    assert [board.address for board in left.boards] == list(layout.addresses)
    np.testing.assert_allclose(left.layout.xy_m, load_layout(layout).xy_m, atol=2e-6)


def cpu_share(pid):
    """Return the fraction of one CPU that the process takes over two seconds."""

    def cpu_s():
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    before_s, began_s = cpu_s(), time.monotonic()
    time.sleep(2.0)
    return (cpu_s() - before_s) / (time.monotonic() - began_s)


def count_new(raws, from_ns):
    """Return how many cycles of the two seconds from `from_ns` on are new."""
    published = itertools.takewhile(lambda raw: raw.t_ns < from_ns + 2 * 10**9, raws)
    return sum(raw.t_ns >= from_ns and not raw.repeated for raw in published)


def starve(group, share, raws):
    """Lower the quota of CPU from `share` on until two counts in a row find less than 60 % of the cycles new.

    How much of what it takes at leisure a daemon can do without depends on the host: it saves much by doing it at once.
    Just after the quota is lowered it publishes less than it does later.
    """
    until, n_starved = time.monotonic() + PATIENCE_S, 0
    while n_starved < 2:
        if not n_starved:
            share *= 0.75
            group.limit(share, 100)
        n_new = count_new(raws, time.time_ns() + 10**9)  # until then what had been received before is published
        n_starved = n_starved + 1 if n_new < 60 else 0
        assert time.monotonic() < until, f"{n_new} cycles in two seconds with {share:.2%} of a CPU"


def test_a_starved_daemon_is_recorded_as_not_usable_with_the_true_share(daemon, tmp_path):
    out = tmp_path / "starved"
    with daemon.boards(), insole_daemon.connect(daemon.endpoint) as insole, Group(daemon.process.pid) as group:
        raws = insole.raws("left")
        next(raws)
        starve(group, cpu_share(daemon.process.pid), raws)
        done = subprocess.run(
            [INSOLE, "record", out, "--remote", "--connect", daemon.endpoint, "--foot", "left", "--seconds", "8"],
            capture_output=True, text=True,
        )  # fmt: skip
        group.limit(1.0, 100)
        raws.close()
    assert done.returncode == 0, done.stderr
    quality = yaml.safe_load((out / "recording.yaml").read_text())["extensions"]["quality"]["left"]
    trial = insole_daemon.load(out)
    left = trial["left"]
    span_s = (left.t_ns[-1] - left.t_ns[0]) * 1e-9
    true_share = np.count_nonzero(~left.repeated) / (span_s * 50)
    assert true_share < 0.8, "it was starved"
    assert quality["verdict"] == "not usable"
    assert quality["share"] == pytest.approx(true_share, abs=0.05)
    assert "left: not usable" in done.stderr
    assert "0 lost" not in done.stderr


def test_a_killed_remote_recorder_leaves_a_file_that_numpy_reads(daemon, tmp_path):
    out = tmp_path / "remote"
    path = out / "counts" / "right.npy"
    with daemon.boards():
        process = subprocess.Popen([INSOLE, "record", out, "--remote", "--connect", daemon.endpoint, "--foot", "right"])
        until = time.time() + PATIENCE_S
        growing = np.empty(0)
        while len(growing) < 50 or time.time_ns() - growing["t_ns"][-1] > 0.5e9:  # until it keeps up
            assert time.time() < until, f"{len(growing)} cycles"
            time.sleep(0.05)
            growing = np.load(path) if path.exists() else growing
        killed_ns = time.time_ns()
        process.kill()
        process.wait()
    trial = insole_daemon.load(out)
    assert [foot.foot for foot in trial.feet] == ["right"]
    assert len(trial["right"]) >= len(growing)
    assert killed_ns - trial["right"].t_ns[-1] < 1e9


def test_an_existing_folder_is_not_overwritten(tmp_path):
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "can.log").write_text("precious")
    done = subprocess.run(
        [INSOLE, "record", tmp_path / "old", "--seconds", "1"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 4
    assert "already there" in done.stderr
    assert (tmp_path / "old" / "can.log").read_text() == "precious"


class Frames:
    """A source with some frames that reports lost frames before them."""

    interfaces = ("can0",)

    def __init__(self, frames: FrameBatch, lost: int) -> None:
        self.counters = BusCounters(overflows=lost)
        self._frames, self.exhausted = frames, False

    def wait(self, timeout_s: float) -> None: ...
    def clock_ns(self) -> int:
        return int(self._frames.t_mono_ns[-1]) if len(self._frames) else 0

    def receive(self) -> int:
        return len(self._frames)

    def drain(self) -> FrameBatch:
        self.exhausted = True
        return self._frames


def test_lost_frames_are_noted_in_the_log(tmp_path, left, walk):
    recorder = LiveRecorder(tmp_path / "trial", "free", [left], 0, ["can0"])
    progress = Session(recorder, threading.Event()).from_bus(Frames(walk, 17))
    recorder.close()
    assert (progress.frames, progress.lost) == (len(walk), 17)
    assert read(tmp_path / "trial" / "can.log").counters.dropped == 17
    trial = insole_daemon.load(tmp_path / "trial")
    assert any("dropped 17 frames" in line for line in trial.warnings)
    assert trial["left"].zero is not None
    assert trial["left"].calibration.provenance == {"by": "a test"}


def test_a_disk_error_is_reported(tmp_path, left, walk, monkeypatch):
    recorder = LiveRecorder(tmp_path / "trial", "free", [left], 0, ["can0"])

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fdatasync", full)
    time.sleep(0.8)
    with pytest.raises(InsoleError, match=r"trial: recording failed: No space left on device; what was written before"):
        recorder.write_frames(walk)
    with pytest.raises(InsoleError, match="recording failed"):
        recorder.close()


def test_a_changed_layout_ends_the_recording(tmp_path, left):
    recorder = LiveRecorder(tmp_path / "trial", "free", [left], 0, None)
    with pytest.raises(InsoleError, match="expected cycles of 28 triangles, found 3: the daemon was restarted"):
        recorder.write_cycle("left", {"counts": np.zeros((3, 12), np.uint8)})
    recorder.close()
    assert len(insole_daemon.load(tmp_path / "trial")["left"]) == 0


def test_a_layout_is_reconstructed_from_its_taxel_positions(left):
    random = np.random.default_rng(6)
    triangles = tuple(
        dataclasses.replace(triangle, rotation_deg=round(float(random.uniform(0, 360)), 2), mirrored=bool(number % 2))
        for number, triangle in enumerate(left.layout.triangles)
    )
    layout = layouts.of("left", 48.5e-6, "tiling cell/10", triangles)
    meta = {
        "foot": "left", "taxel_area_m2": 48.5e-6, "area_meaning": "tiling cell/10", "layout_builtin": False,
        "triangles": [{"board": t.board, "triangle": t.triangle, "patch": t.patch} for t in triangles],
    }  # fmt: skip
    reconstructed = layout_of_meta(meta, layout.xy_m.astype(np.float32))
    assert reconstructed.triangles == triangles
    assert reconstructed.area_meaning == "tiling cell/10"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--kind", "chamber"], "--reference"),
        (["--reference", "-"], "--kind"),
        (["--kind", "chamber", "--reference", "left=-", "--reference", "left=-"], "once for each"),
        (["--kind", "chamber", "--reference", "-"], "left=… or right=…"),
    ],
)
def test_contradicting_options_are_a_usage_error(tmp_path, arguments, words):
    done = subprocess.run(
        [INSOLE, "record", tmp_path / "x", *arguments],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert words in done.stderr
    assert not (tmp_path / "x").exists()
