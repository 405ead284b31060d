"""The recordings of a study on Dask workers: local processes, or a cluster that exists."""

from __future__ import annotations

import contextlib
import logging
import re
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

from ..errors import FileError, InsoleError
from ..recording.lab import need
from . import worker
from .content import program_digest
from .document import Study
from .tasks import Given, TaskResult, do_tasks

TIMES_TRIED = 3  # after so many workers died with a recording, it is given up
LOCAL_WORKERS_TIMEOUT_S = 60.0  # without any, before recordings are given up; Dask restarts one that died in seconds
_ABSENCE_REPORTED_S = 20.0  # without a worker, before the first report
_ASKED_EVERY_S = 5.0
# Dask's own adds MALLOC_TRIM_THRESHOLD_, with which glibc returns every array above 128 kB to the kernel at once: page
# faults then take a third of a worker's CPU time.
_WORKER_ENVIRONMENT = {"OMP_NUM_THREADS": 1, "MKL_NUM_THREADS": 1, "OPENBLAS_NUM_THREADS": 1}
_LOOPBACK = re.compile(r"tcp://(127\.\d+\.\d+\.\d+|localhost|\[::1\]):\d{1,5}")
_WITH_TLS = re.compile(r"tls://.+:\d{1,5}")


@contextlib.contextmanager
def cluster(scheduler: str | None, workers: int, tls: tuple[Path, Path, Path] | None = None) -> Iterator[Any]:
    """Yield a Dask client: of `workers` new local processes, or of the scheduler at an address.

    `tls` are the certificate authority, this client's certificate and its key. InsoleError where a scheduler beyond
    loopback has no TLS: Dask exchanges pickles, so whoever connects to it can run programs on its workers.
    """
    need("distributed", "distributed", "a study")
    from distributed.utils import silence_logging_cmgr

    connection = _local_workers(workers) if scheduler is None else _existing_scheduler(scheduler, tls)
    with silence_logging_cmgr(logging.CRITICAL), connection as client:  # its log has tracebacks; the table has reasons
        yield client


@contextlib.contextmanager
def _local_workers(workers: int) -> Iterator[Any]:
    import dask
    import distributed

    settings = {
        "distributed.scheduler.allowed-failures": TIMES_TRIED - 1,
        "distributed.scheduler.no-workers-timeout": LOCAL_WORKERS_TIMEOUT_S,
        "distributed.worker.profile.enabled": False,  # nobody reads it
        "distributed.nanny.pre-spawn-environ": _WORKER_ENVIRONMENT,
    }
    with dask.config.set(settings), contextlib.ExitStack() as stack:
        with _hold_interrupts():
            local = distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
                preload=[worker.__name__],
            )
            stack.callback(_close, local)
        yield stack.enter_context(distributed.Client(local))


def _close(local: Any) -> None:
    """End the workers. One that is just being started again, after it has died, ends with this process.

    Dask's nanny then fails with "can only join a started process" (seen with distributed 2026.8).
    """
    with contextlib.suppress(AssertionError):
        local.close()


@contextlib.contextmanager
def _existing_scheduler(scheduler: str, tls: tuple[Path, Path, Path] | None) -> Iterator[Any]:
    import distributed

    if not _LOOPBACK.fullmatch(scheduler) and (not _WITH_TLS.fullmatch(scheduler) or tls is None):
        raise InsoleError(
            f"{scheduler}: expected a scheduler on this host, as tcp://127.0.0.1:8786, or tls://HOST:PORT with "
            "--tls-ca, --tls-cert and --tls-key: Dask exchanges pickles, and whoever reaches a scheduler without TLS "
            "can run programs on it"
        )
    security = None
    if tls is not None:
        for file in tls:
            if not file.is_file():
                raise FileError(f"{file}: there is no such file; --tls-ca, --tls-cert and --tls-key name three files")
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


@contextlib.contextmanager
def _hold_interrupts() -> Iterator[None]:
    """Hold Ctrl-C back until the end; processes that this thread's new threads start never get it."""
    held: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, frame: held.append(number))
    resource_tracker.ensure_running()  # it unblocks SIGINT in the thread that starts it
    unblocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # threads and processes inherit it
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, unblocked)
        signal.signal(signal.SIGINT, handler)
    if held:
        signal.raise_signal(signal.SIGINT)


def run_tasks(
    client: Any,
    folder: Path,
    study: Study,
    results: Path,
    report_done: Callable[[int, list[TaskResult]], None],
    report_absence: Callable[[float], None],
) -> list[list[TaskResult]]:
    """Do the tasks of every recording on the workers of `client`; return their results in the order of study.yaml.

    `report_done` is called with the number of each recording and its results as they come, `report_absence` with the
    seconds for which the scheduler has had no workers: after 20, 40, 80 and so on.
    """
    judged = _whole_paths(study.calibrations)
    futures = {}
    for number, recording in enumerate(study.recordings):
        place = folder / recording.folder
        given = Given(judged, _whole_paths(recording.analysed_with), recording.mass_kg)
        future = client.submit(
            do_tasks, str(place.resolve()), str(results_of(results, recording.folder)), study.tasks, given,
            program_digest(), key=f"insole-study-{number}-{place}", pure=False,
        )  # fmt: skip
        futures[future] = number
    outcomes: list[list[TaskResult]] = [[] for _ in study.recordings]
    for future, result in _wait_for_results(client, list(futures), report_absence):
        number = futures[future]
        if isinstance(result, Exception):
            problem = describe_failure(result)
            result = [TaskResult(task, None, problem) for task in study.tasks]
        outcomes[number] = result
        report_done(number, outcomes[number])
    return outcomes


def _wait_for_results(
    client: Any, futures: Sequence[Any], report_absence: Callable[[float], None]
) -> Iterator[tuple[Any, list[TaskResult] | Exception]]:
    """Yield each future with its result, or with the exception that is in its place; ask for workers while none comes.

    Dask itself waits without limit for a worker, both for a task and for a result whose worker left before it was read.
    """
    import distributed

    completed = distributed.as_completed(futures)
    asked_s = present_s = time.monotonic()
    reported_after_s = _ABSENCE_REPORTED_S
    while not completed.is_empty():
        if completed.has_ready():
            future = next(completed)
            result = _read_result(future)
            if result is not None:
                present_s, reported_after_s = time.monotonic(), _ABSENCE_REPORTED_S
                yield future, result
                continue
            completed.add(future)
        else:
            time.sleep(0.05)
        now_s = time.monotonic()
        if now_s < asked_s + _ASKED_EVERY_S:
            continue
        asked_s = now_s
        if client.scheduler_info()["workers"]:
            present_s, reported_after_s = now_s, _ABSENCE_REPORTED_S
        elif now_s >= present_s + reported_after_s:
            report_absence(now_s - present_s)
            reported_after_s *= 2


def _read_result(future: Any) -> list[TaskResult] | Exception | None:
    """Return the result of a completed future, or its exception; None if the worker that has the result left."""
    try:
        result: list[TaskResult] = future.result(timeout=_ASKED_EVERY_S)
    except TimeoutError:
        return None
    except Exception as error:
        return error
    return result


def describe_failure(error: Exception) -> str:
    """Return why Dask has no result of a recording."""
    from distributed.scheduler import KilledWorker, NoWorkerError

    if isinstance(error, CancelledError):
        return "the scheduler does not answer any more: start it and this command again; finished results are reused"
    if isinstance(error, NoWorkerError):
        return (
            f"all workers ended, and none started within {error.timeout:g} s: check the memory and disk of their "
            "computer, and start this command again; finished results are reused"
        )
    if isinstance(error, KilledWorker):
        return (
            f"{error.allowed_failures + 1} workers died with it, the last on {error.last_worker.address}: "
            "it may need more memory than they have"
        )
    return f"{type(error).__name__}: {error}".replace("\n", " ")  # a worker cannot run it at all


def _whole_paths(paths: Sequence[Path]) -> tuple[str, ...]:
    return tuple(str(path.resolve()) for path in paths)


def results_of(results: Path, folder: Path) -> Path:
    """Return the folder of the result files of the recording in `folder`, wherever it stands in study.yaml.

    Results of two recordings with the same name have different keys, or the same content.
    """
    return (results / "-".join(part for part in folder.parts if part != "..")).resolve()
