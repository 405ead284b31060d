"""Speed of decoding a candump log into arrays of counts, and of python-can reading the same log.

    python -m benchmarks.decode.candump

One core, interleaved, the median of five rounds. The log, from a fixed seed, is 150 s of both feet walking (emulated
boards, one foot an interface) with a sixth of other traffic in between: 11- and 29-bit identifiers, 0 to 8 bytes,
interfaces whose names differ in length. python-can reads its first 100 000 lines, which does not change its time
per frame, and only makes messages of them: it pairs nothing.

Takes about a minute.
"""

from __future__ import annotations

import itertools
import os
import statistics
import tempfile
import time
from pathlib import Path

import can
import numpy as np

from insole_daemon.bus import candump
from insole_daemon.bus.candump_writer import CandumpWriter
from insole_daemon.bus.frames import EXTENDED, FrameBatch
from insole_daemon.config import Config
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.foot import Walk
from insole_daemon.skin.cycles import Cycles
from insole_daemon.skin.reader import SkinReader

SECONDS = 150
LINES_OF_PEER = 100_000
ROUNDS = 5
SEED = 20250309
INTERFACES = ("can0", "insole_right", "vcan10")
LAYOUTS = [load_layout(insole) for insole in Config().insoles]


def read_frames(path: Path) -> int:
    """Ours: the file into one batch."""
    return len(candump.read(path).frames)


def read_counts(path: Path) -> int:
    """Ours: the file into the cycles of both feet."""
    reader = SkinReader(LAYOUTS, period_ns=20_000_000, slack_ns=5_000_000)
    feet: list[list[Cycles]] = [[] for _ in LAYOUTS]
    frames = 0
    with candump.CandumpReader(path) as log:
        for batch in log:
            frames += len(batch)
            for foot, closed in zip(feet, reader.feed(batch), strict=True):
                foot += closed
    for foot, layout in zip(feet, LAYOUTS, strict=True):
        counts = Cycles.concatenate(foot, len(layout)).counts
        assert len(counts) >= 50 * (SECONDS - 1), "every cycle is there"
    return frames


def read_messages(path: Path) -> int:
    """python-can: the file into Message objects, one after another."""
    with can.CanutilsLogReader(str(path)) as reader:
        return sum(1 for _ in reader)


def generate(path: Path) -> int:
    """Write the log; how many lines it has."""
    draw = np.random.default_rng(SEED)
    skin = Emulator(Config(), LAYOUTS, Walk(LAYOUTS), seed=SEED).frames(1_741_532_714_334_381_000, SECONDS)
    n = len(skin) // 5
    t_ns = draw.integers(skin.t_ns[0], skin.t_ns[-1], n)
    extended = draw.random(n) < 0.3
    dlc = draw.integers(0, 9, n).astype(np.uint8)
    data = draw.integers(0, 256, (n, 8)).astype(np.uint8)
    data[np.arange(8) >= dlc[:, None]] = 0
    other = FrameBatch(
        t_ns,
        t_ns,
        draw.integers(0, 3, n).astype(np.uint8),
        np.where(extended, draw.integers(0, 1 << 29, n), draw.integers(0, 0x200, n)).astype(np.uint32),
        dlc,
        data,
        np.where(extended, EXTENDED, 0).astype(np.uint8),
    )
    interface = (skin.can_id >> 4 & 0xF >= 8).astype(np.uint8)
    skin = FrameBatch(skin.t_ns, skin.t_mono_ns, interface, skin.can_id, skin.dlc, skin.data, skin.flags)
    both = FrameBatch.concatenate([skin, other])
    both = both[np.argsort(both.t_ns, kind="stable")]
    with CandumpWriter(path, INTERFACES) as writer:
        writer.write(both)
    return len(both)


def main() -> None:
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    with tempfile.TemporaryDirectory() as folder:
        whole, excerpt = Path(folder) / "whole.log", Path(folder) / "excerpt.log"
        lines = generate(whole)
        with whole.open() as file:
            excerpt.write_text("".join(itertools.islice(file, LINES_OF_PEER)))
        contestants = {
            "candump file → paired arrays of counts": (read_counts, whole),
            "candump file → arrays of frames": (read_frames, whole),
            "peer: python-can's CanutilsLogReader": (read_messages, excerpt),
        }
        rates: dict[str, list[float]] = {name: [] for name in contestants}
        for _ in range(ROUNDS):
            for name, (run, path) in contestants.items():
                start = time.perf_counter()
                rates[name].append(run(path) / (time.perf_counter() - start))
        medians = {name: statistics.median(each) for name, each in rates.items()}
        peer = medians["peer: python-can's CanutilsLogReader"]
        print(f"{lines} lines, {whole.stat().st_size / 1e6:.1f} MB; one core, median of {ROUNDS} rounds")
        for name, rate in medians.items():
            print(f"{name:<40} {rate / 1e6:8.3f} M frames/s  {rate / peer:6.1f} × the peer")


if __name__ == "__main__":
    main()
