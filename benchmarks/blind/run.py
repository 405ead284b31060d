"""Runs the tool on every case: `python -m benchmarks.blind.run --cases cases --answers answers -- insole diagnose
{recording} {simulation} --out {out}`.

`{simulation}` becomes `--simulation FOLDER` where a case has one and vanishes where it has none. Every run is logged in
`log.jsonl`, with its command, exit status, seconds and peak memory; none is dropped and none repeated.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

LOG = "log.jsonl"


def command_for(template: list[str], case: Path, out: Path) -> list[str]:
    said = {"{recording}": [str(case / "recording")], "{out}": [str(out)], "{simulation}": []}
    if (case / "simulation").is_dir():
        said["{simulation}"] = ["--simulation", str(case / "simulation")]
    return [word for token in template for word in said.get(token, [token])]


def run_case(template: list[str], case: Path, answers: Path, limit_s: float) -> dict[str, Any]:
    """One run; its output is kept beside its answer."""
    out = answers / case.name
    out.mkdir()
    command = command_for(template, case, out)
    began = time.monotonic()
    with (out / "stdout.txt").open("wb") as stdout, (out / "stderr.txt").open("wb") as stderr:
        child = subprocess.Popen(command, stdout=stdout, stderr=stderr, stdin=subprocess.DEVNULL)
        status, used, ended = _wait(child, began + limit_s)
    return {
        "case": case.name,
        "command": command,
        "status": status,
        "ended": ended,
        "seconds": round(time.monotonic() - began, 3),
        "cpu_seconds": round(used.ru_utime + used.ru_stime, 3),
        "peak_mb": round(used.ru_maxrss / 1024, 1),
    }


def _wait(child: subprocess.Popen[bytes], deadline: float) -> tuple[int, Any, str]:
    """wait4 tells the peak memory of this child alone; nothing in the standard library does."""
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


def run(template: list[str], cases: Path, answers: Path, jobs: int, limit_s: float) -> list[dict[str, Any]]:
    answers.mkdir(parents=True)
    found = sorted(p for p in cases.iterdir() if p.is_dir())
    log = []
    with (answers / LOG).open("w") as file, ThreadPoolExecutor(jobs) as pool:
        for k, entry in enumerate(pool.map(lambda case: run_case(template, case, answers, limit_s), found)):
            log.append(entry)
            file.write(json.dumps(entry) + "\n")
            file.flush()
            print(f"\r{k + 1} of {len(found)} runs", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return log


def main() -> None:
    ask = argparse.ArgumentParser(prog="python -m benchmarks.blind.run", description=__doc__)
    ask.add_argument("--cases", type=Path, required=True)
    ask.add_argument("--answers", type=Path, required=True, help="a folder that does not exist yet")
    ask.add_argument("--jobs", type=int, default=1)
    ask.add_argument("--limit", type=float, default=600.0, help="seconds a run may take")
    ask.add_argument("command", nargs="+", help="after --: the tool and its arguments")
    said = ask.parse_args()
    if said.answers.exists():
        raise SystemExit(f"{said.answers}: expected a folder that does not exist yet; runs are never overwritten")
    run(said.command, said.cases, said.answers, said.jobs, said.limit)


if __name__ == "__main__":
    main()
