"""A study of many recordings on 1, 2 and 4 Dask workers, and with a worker killed at a random moment.

    python -m benchmarks run gait.study [RECORDINGS] [KILLS]

Takes 15 minutes with 40 recordings and 20 kills.

Recordings are of 10 s, both feet; tasks are report and steps. Seconds are those of the work, without the start of the
workers. The results of all runs must be the same bytes.
"""

from __future__ import annotations

import hashlib
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from insole_daemon.config import Config
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.conditions import Conditions
from insole_daemon.simulation.trial import Trial
from insole_daemon.study.collecting import collect_rows, write_tables
from insole_daemon.study.document import load_study
from insole_daemon.study.scheduling import cluster, run_tasks

SECONDS = 10.0
TABLES = ("table.csv", "table.parquet", "steps.csv", "steps.parquet")


def make(folder: Path, recordings: int) -> None:
    """Write the study: persons of different weight, each slow and fast."""
    config = Config()
    layouts = [load_layout(insole) for insole in config.insoles]
    lines = []
    for number in range(recordings):
        name, task = f"r{number:02d}", "t5" if number % 2 else "t4"
        conditions = Conditions(mass_kg=45.0 + number)
        Trial(task, config, layouts, conditions=conditions, seed=number).write(folder / name, SECONDS)
        lines.append(f"  - {{folder: {name}, person: p{number // 2}, session: {task}}}\n")
    (folder / "study.yaml").write_text("format: insole-study/1\nrecordings:\n" + "".join(lines))


def analyse(folder: Path, client: Any) -> tuple[float, str]:
    """Seconds of the work, and a digest of all tables."""
    study = load_study(folder)
    began = time.perf_counter()
    found = run_tasks(client, folder, study, folder / "results", lambda number, outcome: None)
    seconds = time.perf_counter() - began
    rows, every = collect_rows(study, folder / "results", found)
    write_tables(study, rows, every, folder)
    shutil.rmtree(folder / "results")
    assert not any(row["missing"] for row in rows), [row["missing"] for row in rows]
    assert len({row["recording"] for row in rows}) == len(study.recordings)
    return seconds, hashlib.sha256(b"".join((folder / name).read_bytes() for name in TABLES)).hexdigest()


def main() -> None:
    recordings, kills = (int(each) for each in (*sys.argv[1:], "40", "20")[:2])
    digests = set()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        make(folder, recordings)
        print(f"{recordings} recordings of {SECONDS:g} s, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
        alone_s = 0.0
        for workers in (1, 2, 4):
            with cluster(None, workers) as client:
                client.run(_warm)
                seconds, digest = analyse(folder, client)
                peak_mb = max(client.run(_peak_mb).values())
            alone_s = alone_s or seconds
            digests.add(digest)
            print(
                f"{workers} workers: {seconds:.1f} s, {alone_s / seconds:.2f} times one worker, "
                f"{peak_mb:.0f} MB a worker at most",
                flush=True,
            )
        dice = random.Random(23)
        for _ in range(kills):
            with cluster(None, 2) as client:
                client.run(_warm)
                pid = dice.choice(list(client.run(os.getpid).values()))
                timer = threading.Timer(dice.uniform(0.0, 0.8 * alone_s / 2), os.kill, (pid, signal.SIGKILL))
                timer.start()
                digests.add(analyse(folder, client)[1])
                timer.cancel()
        print(f"{kills} runs with a worker killed; different results over all runs: {len(digests)} (1 is right)")


def _warm() -> None:
    """Import what the tasks need: workers of a long study have done it."""
    import insole_daemon.recording.steps
    import insole_daemon.study.tasks
    import insole_daemon.view.recorded  # noqa: F401


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()
