"""`insole prove`: run the blind benchmark of the diagnosis, whose programs are separate processes."""

from __future__ import annotations

import contextlib
import os
import re
import sys
from collections.abc import Callable, Iterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from .options import Scheduler, TlsCa, TlsCert, TlsKey, name_next, tls_of, write_whole
from .progress import show_work

_TOOL = (sys.executable, "-m", "insole_daemon", "diagnose", "{recording}", "{simulation}")
_PREDICTOR = "insole_daemon.diagnosis.prediction:of_folder"
_REFUSED = 4  # exit status of the benchmark's programs where a file cannot be written
_DONE = re.compile(rb"\r(\d+) of (\d+) \w+")  # progress lines of the benchmark's programs on stderr
_STAGES = (0.15, 0.75, 0.1)  # relative durations of making, diagnosing and scoring
_COMPENSATOR = "insole_daemon.diagnosis.compensation:of_walk"


class Suite(StrEnum):
    """The kinds of cases."""

    chamber = "chamber"
    bench = "bench"
    walking = "walking"
    all = "all"


def prove(
    out: Annotated[Path, typer.Option("--out", help="Folder for cases, truth, answers and tables; it must not exist.")],
    cases: Annotated[int, typer.Option("--cases", min=1, help="Number of cases.")] = 120,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Seed of the cases; drawn by default.")] = None,
    suite: Annotated[Suite, typer.Option("--suite", help="Which kinds of cases; bench is a short fixed list.")] = (
        Suite.all
    ),
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="Cases to run at a time, on local Dask workers.")] = 1,
    scheduler: Scheduler = None,
    tls_ca: TlsCa = None,
    tls_cert: TlsCert = None,
    tls_key: TlsKey = None,
) -> None:
    """Prove the diagnosis on cases in which physics is concealed: generate, seal, diagnose, score.

    Generator and scorer share no module with this package. The seal is printed first and the tables last; cases,
    truth, every run and its log stay in the folder.
    """
    import secrets

    from ..errors import FileError

    out = out.resolve()
    if out.exists():
        raise FileError(f"{out}: is already there; name another folder, runs are never overwritten")
    case_folder, sealed, answers, tables = (out / name for name in ("cases", "sealed", "answers", "tables.md"))
    drawn = secrets.randbelow(2**31) if seed is None else seed
    tls = tls_of(tls_ca, tls_cert, tls_key)
    make_share, diagnose_share, _ = _STAGES
    with _workers(scheduler, jobs, tls) as workers, _kept_unless_empty(out), show_work("proving", _STAGES) as work:
        out.mkdir(parents=True)
        work(f"{cases} cases of {suite.value}, seed {drawn}, into {out}")
        seal = _run(
            lambda share: work.done(make_share * share), "make", "--cases", cases, "--suite", suite.value,
            "--seed", drawn, "--out", case_folder, "--sealed", sealed, *workers,
        ).strip()  # fmt: skip
        print(f"Seal: {seal}", flush=True)
        work("diagnosing them")
        _run(
            lambda share: work.done(make_share + diagnose_share * share), "run", "--cases", case_folder,
            "--answers", answers, *workers, "--", *_TOOL, "--out", "{out}",
        )  # fmt: skip
        work("scoring the answers")
        scored = _run(
            work.done, "score", "--sealed", sealed, "--answers", answers, "--seal", seal, "--predictor", _PREDICTOR,
            "--compensator", _COMPENSATOR, "--json", out / "score.json",
        )  # fmt: skip
    write_whole(tables, scored)
    print(scored, end="", flush=True)
    name_next(f"open {tables}; the report of each case is in {answers}")


@contextlib.contextmanager
def _workers(scheduler: str | None, jobs: int, tls: tuple[Path, Path, Path] | None) -> Iterator[list[str]]:
    """The option that names the workers to the benchmark's programs; none where one case is taken after the other."""
    if scheduler is None and jobs == 1:
        yield []
        return
    from ..study.scheduling import cluster

    _, checkout = _benchmark()
    if checkout is not None:
        sys.path.insert(0, str(checkout))  # local workers inherit it
    with cluster(scheduler, jobs, tls) as client:
        if tls is not None:  # the programs are processes of their own, which Dask configures from here
            names = ("CA_FILE", "CLIENT__CERT", "CLIENT__KEY")
            os.environ |= {
                f"DASK_DISTRIBUTED__COMM__TLS__{name}": str(path) for name, path in zip(names, tls, strict=True)
            }
            os.environ["DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION"] = "true"
        yield ["--scheduler", client.scheduler.address]


@contextlib.contextmanager
def _kept_unless_empty(folder: Path) -> Iterator[None]:
    """Remove `folder` at the end where nothing is in it, so that its name can be used again."""
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            folder.rmdir()


def _benchmark() -> tuple[str, Path | None]:
    """Name of the blind benchmark's package and the folder to run it from: a checkout's own, else the installed one."""
    root = Path(__file__).parents[2]
    if (root / "benchmarks" / "diagnosis" / "blind").is_dir():
        return "benchmarks.diagnosis.blind", root
    return "insole_blind", None


def _run(report_share: Callable[[float], None], program: str, *arguments: object) -> str:
    """Run one program of the benchmark and return its stdout; InsoleError if it fails.

    `report_share` is called with the share of the work that is done.
    """
    import subprocess
    import tempfile

    from ..errors import FileError, InsoleError

    package, root = _benchmark()
    command = [sys.executable, "-m", package, program, *map(str, arguments)]
    with tempfile.TemporaryFile("w+") as printed:
        with subprocess.Popen(command, cwd=root, stdout=printed, stderr=subprocess.PIPE) as process:
            assert process.stderr is not None
            _follow(process.stderr.fileno(), report_share)
        if process.returncode:
            failed = FileError if process.returncode == _REFUSED else InsoleError
            raise failed(f"insole prove: {program} ended with status {process.returncode}: see the line above")
        printed.seek(0)
        return printed.read()


def _follow(pipe: int, report_share: Callable[[float], None]) -> None:
    """Read the stderr `pipe` of a program: pass its progress to `report_share` and everything else to stderr."""
    while text := os.read(pipe, 1 << 16):
        for count, total in _DONE.findall(text):
            report_share(int(count) / int(total))
        sys.stderr.write(_DONE.sub(b"", text).lstrip(b"\n").decode(errors="replace"))
