"""`insole study`: many recordings of many people, analysed in parallel into one table and one page."""

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
    """Analyse every recording of a study, and collect them into table.csv, steps.csv, Parquet and study.html.

    What is done is not done again, unless a recording changed. Exit status: 0 everything is there, 1 something is
    missing, and the table says what and why.
    """
    from ..study.collecting import collect_rows, write_tables
    from ..study.document import load_study
    from ..study.page import study_page
    from ..study.scheduling import cluster, run_tasks

    given = load_study(folder)
    tls = tls_of(tls_ca, tls_cert, tls_key)

    numbers = itertools.count(1)
    with cluster(scheduler, workers or os.cpu_count() or 1, tls) as client, show_work(f"analysing {folder}") as work:

        def told(number: int, found: list[TaskResult]) -> None:
            problems = "; ".join(f"{each.task}: {each.problem}" for each in found if each.file is None)
            work(f"{given.recordings[number].folder}: {problems or 'done'}")
            work.done(next(numbers) / len(given.recordings))

        found = run_tasks(client, folder, given, folder / RESULTS, told)
    rows, every = collect_rows(given, folder / RESULTS, found)
    write_tables(given, rows, every, folder)
    write_whole(folder / "study.html", study_page(folder.resolve().name, given, rows, every))
    missing = sum(bool(each["missing"]) for each in rows)
    print(f"{folder / 'table.csv'}: {len(rows)} recordings, {missing} with something missing")
    name_next(f"open {folder / 'study.html'}")
    if missing:
        raise typer.Exit(1)
