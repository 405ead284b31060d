"""`insole prove`: the blind benchmark of the diagnosis, from sealed cases to tables; its programs stay its own."""

from __future__ import annotations

import contextlib
import os
import secrets
import subprocess
import sys
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from .options import Scheduler, TlsCa, TlsCert, TlsKey, tls_of, write_whole

_TOOL = (sys.executable, "-c", "from insole_daemon.cli import main; main()", "diagnose", "{recording}", "{simulation}")
_PREDICTOR = "insole_daemon.diagnosis.prediction:of_folder"
_COMPENSATOR = "insole_daemon.diagnosis.compensation:of_walk"


class Suite(StrEnum):
    """Which kinds of cases."""

    chamber = "chamber"
    bench = "bench"
    walking = "walking"
    all = "all"


def prove(
    out: Annotated[Path, typer.Option("--out", help="Folder for cases, truth, answers and tables; not there yet.")],
    cases: Annotated[int, typer.Option("--cases", min=1, help="How many.")] = 120,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Of the cases; drawn where it is not said.")] = None,
    suite: Annotated[Suite, typer.Option("--suite", help="Which kinds of cases; bench is a short fixed list.")] = (
        Suite.all
    ),
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="How many at a time, on local Dask workers.")] = 1,
    scheduler: Scheduler = None,
    tls_ca: TlsCa = None,
    tls_cert: TlsCert = None,
    tls_key: TlsKey = None,
) -> None:
    """Prove the diagnosis on cases in which physics is concealed: generate, seal, diagnose, score.

    Generator and scorer share no module with this package. The seal is printed first and the tables last; cases,
    truth, every run and its log stay in the folder.
    """
    from ..errors import FileError

    out = out.resolve()
    if out.exists():
        raise FileError(f"{out}: is already there; name another folder, runs are never overwritten")
    given, sealed, answers, tables = (out / name for name in ("cases", "sealed", "answers", "tables.md"))
    drawn = secrets.randbelow(2**31) if seed is None else seed
    tls = tls_of(tls_ca, tls_cert, tls_key)
    with _workers(scheduler, jobs, tls) as workers:
        out.mkdir(parents=True)
        print(f"insole: {cases} cases of {suite.value}, seed {drawn}, into {out}", file=sys.stderr, flush=True)
        seal = _run(
            "make", "--cases", cases, "--suite", suite.value, "--seed", drawn, "--out", given,
            "--sealed", sealed, *workers,
        ).strip()  # fmt: skip
        print(f"Seal: {seal}", flush=True)
        _run("run", "--cases", given, "--answers", answers, *workers, "--", *_TOOL, "--out", "{out}")
    scored = _run(
        "score", "--sealed", sealed, "--answers", answers, "--seal", seal, "--predictor", _PREDICTOR,
        "--compensator", _COMPENSATOR, "--json", out / "score.json",
    )  # fmt: skip
    write_whole(tables, scored)
    print(scored, end="")


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


def _benchmark() -> tuple[str, Path | None]:
    """Name of the blind benchmark's package and the folder to run it from: a checkout's own, else the installed one."""
    root = Path(__file__).parents[2]
    if (root / "benchmarks" / "diagnosis" / "blind").is_dir():
        return "benchmarks.diagnosis.blind", root
    return "insole_blind", None


def _run(program: str, *arguments: object) -> str:
    """Run one program of the benchmark, show its progress, return its stdout. InsoleError where it fails."""
    from ..errors import InsoleError

    package, root = _benchmark()
    command = [sys.executable, "-m", package, program, *map(str, arguments)]
    done = subprocess.run(command, cwd=root, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        raise InsoleError(f"{' '.join(command[1:4])} … ended with status {done.returncode}: see what it said above")
    return done.stdout
