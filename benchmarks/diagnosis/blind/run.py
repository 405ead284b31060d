"""Runs a tool on every case of a set, and goes on where it stopped."""

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
    """The tool is not there."""


def command_for(template: list[str], case: Path, out: Path) -> list[str]:
    """The command of one case: `{simulation}` becomes `--simulation FOLDER`, or vanishes where a case has none."""
    said = {"{recording}": [str(case / "recording")], "{out}": [str(out)], "{simulation}": []}
    if (case / "simulation").is_dir():
        said["{simulation}"] = ["--simulation", str(case / "simulation")]
    return [word for token in template for word in said.get(token, [token])]


def run_case(template: list[str], case: Path, answers: Path, limit_s: float) -> dict[str, Any]:
    """One run; its output is kept beside its answer."""
    out = answers / case.name
    if out.exists():  # of a run that was interrupted
        shutil.rmtree(out)
    out.mkdir()
    command = command_for(template, case, out)
    began = time.monotonic()
    with (out / "stdout.txt").open("wb") as stdout, (out / "stderr.txt").open("wb") as stderr:
        try:
            child = subprocess.Popen(command, stdout=stdout, stderr=stderr, stdin=subprocess.DEVNULL)
        except OSError as problem:
            raise CannotRunError(f"{command[0]}: cannot be run: {problem}; name the tool's command after --") from None
        status, used, ended = _wait(child, began + limit_s)
    stderr_text = (out / "stderr.txt").read_text(errors="replace")
    return {
        "case": case.name,
        "command": command,
        "status": status,
        "ended": ended,
        "traceback": "Traceback (most recent call last)" in stderr_text,
        "seconds": round(time.monotonic() - began, 3),
        "cpu_seconds": round(used.ru_utime + used.ru_stime, 3),
        "peak_mb": round(used.ru_maxrss / 1024, 1),
    }


def _wait(child: subprocess.Popen[bytes], deadline: float) -> tuple[int, Any, str]:
    """wait4 gives the peak memory of this child alone; nothing in the standard library does."""
    ended = "by itself"
    while True:
        pid, status, used = os.wait4(child.pid, os.WNOHANG)
        if pid:
            child.returncode = os.waitstatus_to_exitcode(status)
            return child.returncode, used, ended
        if time.monotonic() > deadline and ended == "by itself":
            child.kill()
            ended = "stopped at the time limit"
        time.sleep(0.02)


def commit(of: Path) -> str:
    """The commit of the checkout that `of` lies in, with `-dirty` where files differ from it; `unknown` outside one."""
    done = subprocess.run(
        ["git", "-C", str(of), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"],
        capture_output=True,
        text=True,
    )
    return done.stdout.strip() if done.returncode == 0 else "unknown"


def read_log(answers: Path) -> list[dict[str, Any]]:
    """The runs that ended, in order; a line that was cut off by an interruption is left out."""
    if not (answers / LOG).exists():
        return []
    found = []
    for line in (answers / LOG).read_text().splitlines():
        try:
            found.append(json.loads(line))
        except ValueError:
            continue
    return found


def _begin(template: list[str], cases: Path, answers: Path) -> None:
    """Write down commit, seed and command before the first run; on going on, check that they are the same."""
    about = json.loads((cases / SET).read_text())
    header = {"commit": commit(Path.cwd()), "set": about, "command": template, "python": platform.python_version()}
    if (answers / HEADER).exists():
        before = json.loads((answers / HEADER).read_text())
        for key in ("commit", "set", "command"):
            if before[key] != header[key]:
                raise SystemExit(
                    f"{answers}: was begun with {key} {before[key]}, now it is {header[key]}; "
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
    """Run what has not been run yet, on the workers of a Dask scheduler if one is named; returns the whole log."""
    cases, answers = cases.resolve(), answers.resolve()
    _begin(template, cases, answers)
    log = read_log(answers)
    (answers / LOG).write_text("".join(json.dumps(entry) + "\n" for entry in log))
    ran = {entry["case"] for entry in log}
    left = [p for p in sorted(cases.iterdir()) if p.is_dir() and p.name not in ran]
    workers = ThreadPoolExecutor(1) if scheduler is None else dask_executor(scheduler)
    with (answers / LOG).open("a") as file, workers as pool:
        waiting = [pool.submit(run_case, template, case, answers, limit_s) for case in left]
        try:
            for entry in _ended(waiting):
                log.append(entry)
                file.write(json.dumps(entry) + "\n")
                file.flush()
                print(f"\r{len(log)} of {len(ran) + len(left)} runs", end="", file=sys.stderr, flush=True)
        except CannotRunError as problem:
            raise SystemExit(str(problem)) from None
        finally:
            for future in waiting:
                future.cancel()
    print(file=sys.stderr)
    return log


def _ended(waiting: list[Any]) -> Iterable[dict[str, Any]]:
    for future in as_completed(waiting):
        yield future.result()
