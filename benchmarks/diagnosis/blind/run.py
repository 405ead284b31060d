"""Runs a tool on every case of a set; an interrupted run continues where it stopped."""

import json
import os
import platform
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from .generate import SET
from .workers import dask_executor

LOG = "log.jsonl"
HEADER = "run.json"


class CannotRunError(Exception):
    """The tool's command cannot be started."""


def command_for(template: list[str], case: Path, out: Path) -> list[str]:
    """Command of one case. `{simulation}` becomes `--simulation FOLDER`, or nothing if the case has none."""
    replacements = {"{recording}": [str(case / "recording")], "{out}": [str(out)], "{simulation}": []}
    if (case / "simulation").is_dir():
        replacements["{simulation}"] = ["--simulation", str(case / "simulation")]
    return [argument for token in template for argument in replacements.get(token, [token])]


def run_case(template: list[str], case: Path, answers: Path, limit_s: float) -> dict[str, Any]:
    """Run the tool on one case and return the entry for the log; its output is written beside its answer."""
    out = answers / case.name
    if out.exists():  # left by an interrupted run
        shutil.rmtree(out)
    out.mkdir()
    command = command_for(template, case, out)
    started = time.monotonic()
    with (out / "stdout.txt").open("wb") as stdout, (out / "stderr.txt").open("wb") as stderr:
        try:
            child = subprocess.Popen(command, stdout=stdout, stderr=stderr, stdin=subprocess.DEVNULL)
        except OSError as problem:
            raise CannotRunError(f"{command[0]}: cannot be run: {problem}; name the tool's command after --") from None
        status, usage, ended = _wait(child, started + limit_s)
    stderr_text = (out / "stderr.txt").read_text(errors="replace")
    return {
        "case": case.name,
        "command": command,
        "status": status,
        "ended": ended,
        "traceback": "Traceback (most recent call last)" in stderr_text,
        "seconds": round(time.monotonic() - started, 3),
        "cpu_seconds": round(usage.ru_utime + usage.ru_stime, 3),
        "peak_mb": round(usage.ru_maxrss / 1024, 1),
    }


def _wait(child: subprocess.Popen[bytes], deadline: float) -> tuple[int, Any, str]:
    """Wait for `child`, kill it at the deadline; return exit status, resource usage and how it ended.

    os.wait4 reports the peak memory of this child alone, which subprocess cannot.
    """
    ended = "by itself"
    while True:
        pid, status, usage = os.wait4(child.pid, os.WNOHANG)
        if pid:
            child.returncode = os.waitstatus_to_exitcode(status)
            return child.returncode, usage, ended
        if time.monotonic() > deadline and ended == "by itself":
            child.kill()
            ended = "stopped at the time limit"
        time.sleep(0.02)


def commit(folder: Path) -> str:
    """Commit of the checkout that contains `folder`, with `-dirty` if files differ; `unknown` outside a checkout."""
    git = subprocess.run(
        ["git", "-C", str(folder), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"],
        capture_output=True,
        text=True,
    )
    return git.stdout.strip() if git.returncode == 0 else "unknown"


def read_log(answers: Path) -> list[dict[str, Any]]:
    """Entries of the runs that ended, in order, without a line that an interruption cut off."""
    if not (answers / LOG).exists():
        return []
    runs = []
    for line in (answers / LOG).read_text().splitlines():
        try:
            runs.append(json.loads(line))
        except ValueError:
            continue
    return runs


def _check_or_write_header(template: list[str], cases: Path, answers: Path) -> None:
    """Write commit, seed and command before the first run; when a run continues, check that they are the same."""
    description = json.loads((cases / SET).read_text())
    header = {
        "commit": commit(Path.cwd()),
        "set": description,
        "command": template,
        "python": platform.python_version(),
    }
    if (answers / HEADER).exists():
        earlier = json.loads((answers / HEADER).read_text())
        for key in ("commit", "set", "command"):
            if earlier[key] != header[key]:
                raise SystemExit(
                    f"{answers}: was begun with {key} {earlier[key]}, now it is {header[key]}; "
                    "go on with what it was begun with, or name another folder for the answers"
                )
        return
    if answers.exists() and any(answers.iterdir()):
        raise SystemExit(f"{answers}: holds files of something else; name a folder that does not exist yet")
    answers.mkdir(parents=True, exist_ok=True)
    (answers / HEADER).write_text(
        json.dumps({**header, "cores": os.cpu_count(), "begun": time.time()}, indent=1) + "\n"
    )


def run(
    template: list[str], cases: Path, answers: Path, limit_s: float, scheduler: str | None = None
) -> list[dict[str, Any]]:
    """Run the cases that have not been run yet, on the workers of a Dask scheduler if given; return the whole log."""
    cases, answers = cases.resolve(), answers.resolve()
    _check_or_write_header(template, cases, answers)
    log = read_log(answers)
    (answers / LOG).write_text("".join(json.dumps(entry) + "\n" for entry in log))
    names_run = {entry["case"] for entry in log}
    remaining = [folder for folder in sorted(cases.iterdir()) if folder.is_dir() and folder.name not in names_run]
    workers = ThreadPoolExecutor(1) if scheduler is None else dask_executor(scheduler)
    with (answers / LOG).open("a") as file, workers as pool:
        futures = [pool.submit(run_case, template, case, answers, limit_s) for case in remaining]
        try:
            for entry in _in_order_of_end(futures):
                log.append(entry)
                file.write(json.dumps(entry) + "\n")
                file.flush()
                print(f"\r{len(log)} of {len(names_run) + len(remaining)} runs", end="", file=sys.stderr, flush=True)
        except CannotRunError as problem:
            raise SystemExit(str(problem)) from None
        finally:
            for future in futures:
                future.cancel()
    print(file=sys.stderr)
    return log


def _in_order_of_end(futures: list[Any]) -> Iterable[dict[str, Any]]:
    """Yield results of the futures as they end."""
    for future in as_completed(futures):
        yield future.result()
