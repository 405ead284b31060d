"""`insole study`: analyse many recordings of many people in parallel into one table and one page."""

from __future__ import annotations

import itertools
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import Scheduler, TlsCa, TlsCert, TlsKey, name_next, tls_of, write_whole
from .progress import show_work

if TYPE_CHECKING:
    from ..study.tasks import TaskResult

RESULTS = "results"


def study(
    folder: Annotated[Path, typer.Argument(help="Folder with a study.yaml; results are written into it.")],
    scheduler: Scheduler = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, help="Local processes; left out: one a core.")
    ] = None,
    tls_ca: TlsCa = None,
    tls_cert: TlsCert = None,
    tls_key: TlsKey = None,
) -> None:
    """Analyse every recording of a study and collect the results into table.csv, steps.csv, Parquet and study.html.

    Finished results are reused unless a recording changed. Exit status: 0 all results exist, 1 some are missing; the
    table lists them with the reason.
    """
    from ..study.collecting import collect_rows, write_tables
    from ..study.document import load_study
    from ..study.page import study_page
    from ..study.scheduling import LOCAL_WORKERS_TIMEOUT_S, cluster, run_tasks
    from ..study.tasks import describe_problems

    document = load_study(folder)
    tls = tls_of(tls_ca, tls_cert, tls_key)

    numbers = itertools.count(1)
    with cluster(scheduler, workers or os.cpu_count() or 1, tls) as client, show_work(f"analysing {folder}") as work:

        def report_recording(number: int, results: list[TaskResult]) -> None:
            work(f"{document.recordings[number].folder}: {describe_problems(results) or 'done'}")
            work.done(next(numbers) / len(document.recordings))

        def report_absence(seconds: float) -> None:
            time = f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} minutes"
            if scheduler is None:
                work(
                    f"no worker has been running on this host for {time}: after {LOCAL_WORKERS_TIMEOUT_S:.0f} s, the "
                    "recordings that are not done are given up"
                )
            else:
                work(
                    f"{scheduler} has had no workers for {time}: waiting for one; {_how_to_start_worker(scheduler)}, "
                    "and Ctrl-C keeps the finished results"
                )

        if scheduler is not None and not client.scheduler_info()["workers"]:
            work(f"{scheduler} has no workers: waiting for one; {_how_to_start_worker(scheduler)}")
        results = run_tasks(client, folder, document, folder / RESULTS, report_recording, report_absence)
    rows, steps = collect_rows(document, folder / RESULTS, results)
    write_tables(document, rows, steps, folder)
    write_whole(folder / "study.html", study_page(folder.resolve().name, document, rows, steps))
    missing = sum(bool(row["missing"]) for row in rows)
    print(f"{folder / 'table.csv'}: {len(rows)} recordings, {missing} with something missing")
    name_next(f"open {folder / 'study.html'}")
    if missing:
        raise typer.Exit(1)


def _how_to_start_worker(scheduler: str) -> str:
    certificates = " with --tls-ca-file, --tls-cert and --tls-key" if scheduler.startswith("tls:") else ""
    return f"dask worker {scheduler}{certificates} starts one"
