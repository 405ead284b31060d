"""Speed of a study on 1, 2 and 4 Dask workers, and its result if a worker is killed at a random moment.

    python -m benchmarks run gait.study [RECORDINGS] [KILLS]

Takes 15 minutes with 40 recordings and 20 kills.

Recordings are of 10 s, both feet; tasks are report and steps. Seconds are those of the work, without the start of the
workers. The results of all runs must be the same bytes. Collecting is measured on the results of each recording taken
1, 4 and 16 times. Where other programs use the cores too, as many processes of pure arithmetic, before and after each
run, tell what the machine had to offer.
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
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from insole_daemon.config import Config
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.conditions import Conditions
from insole_daemon.simulation.trial import Trial
from insole_daemon.study.collecting import collect_rows, write_tables
from insole_daemon.study.content import program_digest
from insole_daemon.study.document import load_study
from insole_daemon.study.page import study_page
from insole_daemon.study.scheduling import cluster, results_of, run_tasks
from insole_daemon.study.tasks import Given, TaskResult, do_tasks

SECONDS = 10.0
SPUN_S = 3.0
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


def analyse(folder: Path, client: Any) -> tuple[float, float, str]:
    """Seconds of the work, CPU seconds of all workers, and a digest of all tables."""
    study = load_study(folder)
    shutil.rmtree(folder / "results", ignore_errors=True)
    began, cpu_s = time.perf_counter(), _cpu_of_workers_s(client)
    outcomes = run_tasks(client, folder, study, folder / "results", lambda number, outcome: None, print)
    seconds, cpu_s = time.perf_counter() - began, _cpu_of_workers_s(client) - cpu_s
    rows, steps_of_recordings = collect_rows(study, folder / "results", outcomes)
    write_tables(study, rows, steps_of_recordings, folder)
    assert not any(row["missing"] for row in rows), [row["missing"] for row in rows]
    assert len({row["recording"] for row in rows}) == len(study.recordings)
    return seconds, cpu_s, hashlib.sha256(b"".join((folder / name).read_bytes() for name in TABLES)).hexdigest()


def collect(folder: Path, times: int) -> tuple[float, float]:
    """Seconds, and MB at most, of collecting each recording's results `times` times, as of a study so much larger."""
    study = load_study(folder)
    larger, out = replace(study, recordings=study.recordings * times), folder / f"larger-{times}"
    out.mkdir()
    outcomes = []
    for recording in larger.recordings:
        files = {
            path.name.partition("-")[0]: path.name
            for path in results_of(folder / "results", recording.folder).iterdir()
        }
        outcomes.append([TaskResult(task, files[task], "") for task in study.tasks])
    began = time.perf_counter()
    rows, steps_of_recordings = collect_rows(larger, folder / "results", outcomes)
    write_tables(larger, rows, steps_of_recordings, out)
    (out / "study.html").write_text(study_page("larger", larger, rows, steps_of_recordings))
    return time.perf_counter() - began, _peak_mb()


def main() -> None:
    recordings, kills = (int(argument) for argument in (*sys.argv[1:], "40", "20")[:2])
    digests = set()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        make(folder, recordings)
        print(f"{recordings} recordings of {SECONDS:g} s, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
        alone_s = alone_offered = 0.0
        for workers in (1, 2, 4):
            with cluster(None, workers) as client:
                client.run(_warm, folder / "r00")
                offered = spin(workers)
                seconds, cpu_s, digest = analyse(folder, client)
                offered = (offered + spin(workers)) / 2
                peak_mb = max(client.run(_peak_mb).values())
            alone_s, alone_offered = alone_s or seconds, alone_offered or offered
            digests.add(digest)
            print(
                f"{workers} workers: {seconds:.1f} s, {alone_s / seconds:.2f} times one worker, where arithmetic alone "
                f"got {offered / alone_offered:.2f} times as much; {cpu_s / recordings:.2f} s of CPU a recording, "
                f"{peak_mb:.0f} MB a worker at most",
                flush=True,
            )
        for times in (1, 4, 16):
            with ProcessPoolExecutor(1, get_context("spawn")) as fresh:
                seconds, peak_mb = fresh.submit(collect, folder, times).result()
            print(f"collecting {times * recordings} recordings: {seconds:.1f} s, {peak_mb:.0f} MB", flush=True)
        dice = random.Random(23)
        killed = 0
        for _ in range(kills):
            with cluster(None, 2) as client:
                client.run(_warm, folder / "r00")
                pid = dice.choice(list(client.run(os.getpid).values()))
                timer = threading.Timer(dice.uniform(0.0, 0.8 * alone_s / 2), os.kill, (pid, signal.SIGKILL))
                timer.start()
                digests.add(analyse(folder, client)[2])
                killed += not timer.is_alive()
                timer.cancel()
        print(f"{kills} runs, a worker killed in {killed}; different results of all runs: {len(digests)} (1 is right)")


def _warm(recording: Path) -> None:
    """Analyse a recording, as workers of a long study have: imports and what is computed once are done then."""
    with tempfile.TemporaryDirectory() as results:
        do_tasks(str(recording), results, ("report", "steps"), Given(), program_digest())


def spin(processes: int) -> float:
    """Rounds of arithmetic a second that this many processes get from the machine as it is now."""
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        list(pool.map(_rounds_a_second, [0.1] * processes))  # all of them have started
        return sum(pool.map(_rounds_a_second, [SPUN_S] * processes))


def _rounds_a_second(seconds: float) -> float:
    rounds, end = 0, time.perf_counter() + seconds
    while time.perf_counter() < end:
        sum(range(1000))
        rounds += 1
    return rounds / seconds


def _cpu_of_workers_s(client: Any) -> float:
    """CPU seconds of all workers but one that is killed at this moment."""
    return float(sum(client.run(_cpu_s, on_error="ignore").values()))


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()
