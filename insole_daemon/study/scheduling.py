"""The recordings of a study on Dask workers: local processes, or a cluster that exists."""

from __future__ import annotations

import contextlib
import logging
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from ..errors import InsoleError
from ..recording.lab import need
from .document import Study
from .tasks import Given, TaskResult, do_tasks

TIMES_TRIED = 3  # after so many workers died with a recording, it is given up
# Dask's own adds MALLOC_TRIM_THRESHOLD_, with which glibc returns every array above 128 kB to the kernel at once: page
# faults then take a third of a worker's CPU time.
_WORKER_ENVIRONMENT = {"OMP_NUM_THREADS": 1, "MKL_NUM_THREADS": 1, "OPENBLAS_NUM_THREADS": 1}
_LOOPBACK = re.compile(r"tcp://(127\.\d+\.\d+\.\d+|localhost|\[::1\])(:\d+)?")


@contextlib.contextmanager
def cluster(scheduler: str | None, workers: int, tls: tuple[Path, Path, Path] | None = None) -> Iterator[Any]:
    """Yield a Dask client: of `workers` new local processes, or of the scheduler at an address.

    `tls` are the certificate authority, this client's certificate and its key. InsoleError where a scheduler beyond
    loopback has no TLS: Dask exchanges pickles, so whoever connects to it can run programs on its workers.
    """
    distributed = need("distributed", "distributed", "a study")
    if scheduler is None:
        import dask

        settings = {
            "distributed.scheduler.allowed-failures": TIMES_TRIED,
            "distributed.worker.profile.enabled": False,  # nobody reads it
            "distributed.nanny.pre-spawn-environ": _WORKER_ENVIRONMENT,
        }
        with dask.config.set(settings):
            with (
                distributed.LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                ) as local,
                distributed.Client(local) as client,
            ):
                yield client
        return
    if not _LOOPBACK.fullmatch(scheduler) and (not scheduler.startswith("tls://") or tls is None):
        raise InsoleError(
            f"{scheduler}: expected a scheduler on this host, as tcp://127.0.0.1:8786, or tls:// with --tls-ca, "
            "--tls-cert and --tls-key: Dask exchanges pickles, and whoever reaches a scheduler without TLS can run "
            "programs on it"
        )
    security = None
    if tls is not None:
        ca, certificate, key = map(str, tls)
        security = distributed.Security(
            tls_ca_file=ca, tls_client_cert=certificate, tls_client_key=key, require_encryption=True
        )
    try:
        client = distributed.Client(scheduler, security=security, timeout=10)
    except (OSError, TimeoutError) as error:
        why = "" if tls is None else ", or it and this client do not trust each other's certificate: check --tls-ca"
        raise InsoleError(f"{scheduler}: no Dask scheduler answers: start one with `dask scheduler`{why}") from error
    with client:
        yield client


def run_tasks(
    client: Any, folder: Path, study: Study, results: Path, report_done: Callable[[int, list[TaskResult]], None]
) -> list[list[TaskResult]]:
    """Do the tasks of every recording on the workers of `client`; return their results in the order of study.yaml.

    `report_done` is called with the number of each recording and its results as they come.
    """
    distributed = need("distributed", "distributed", "a study")
    judged = _whole_paths(study.calibrations)
    futures = {}
    for number, recording in enumerate(study.recordings):
        place = folder / recording.folder
        given = Given(judged, _whole_paths(recording.analysed_with), recording.mass_kg)
        future = client.submit(
            do_tasks, str(place.resolve()), str(results_of(results, number, recording.folder)), study.tasks, given,
            key=f"insole-study-{number}-{place}", pure=False,
        )  # fmt: skip
        futures[future] = number
    outcomes: list[list[TaskResult]] = [[] for _ in study.recordings]
    for future in distributed.as_completed(list(futures)):
        number = futures[future]
        try:
            outcomes[number] = future.result()
        except Exception as error:  # a worker died again and again, or ran out of memory: Dask says what it knows
            problem = f"{type(error).__name__}: {error}".replace("\n", " ")
            outcomes[number] = [TaskResult(task, None, problem) for task in study.tasks]
        report_done(number, outcomes[number])
    return outcomes


def _whole_paths(paths: Sequence[Path]) -> tuple[str, ...]:
    return tuple(str(path.resolve()) for path in paths)


def results_of(results: Path, number: int, folder: Path) -> Path:
    """Return the folder of the result files of recording `number`, which no other recording has."""
    return (results / f"{number + 1:04d}-{folder.name}").resolve()
