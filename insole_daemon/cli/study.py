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
    from ..study.scheduling import cluster, run_tasks
    from ..study.tasks import describe_problems

    document = load_study(folder)
    tls = tls_of(tls_ca, tls_cert, tls_key)

    numbers = itertools.count(1)
    with cluster(scheduler, workers or os.cpu_count() or 1, tls) as client, show_work(f"analysing {folder}") as work:

        def report_recording(number: int, results: list[TaskResult]) -> None:
            work(f"{document.recordings[number].folder}: {describe_problems(results) or 'done'}")
            work.done(next(numbers) / len(document.recordings))

        if not client.scheduler_info()["workers"]:
            work(f"{scheduler} has no workers: waiting for one; dask worker {scheduler} starts one")
        results = run_tasks(client, folder, document, folder / RESULTS, report_recording)
    rows, steps = collect_rows(document, folder / RESULTS, results)
    write_tables(document, rows, steps, folder)
    write_whole(folder / "study.html", study_page(folder.resolve().name, document, rows, steps))
    missing = sum(bool(row["missing"]) for row in rows)
    print(f"{folder / 'table.csv'}: {len(rows)} recordings, {missing} with something missing")
    name_next(f"open {folder / 'study.html'}")
    if missing:
        raise typer.Exit(1)
