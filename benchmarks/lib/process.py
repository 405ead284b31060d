"""Processes of a benchmark: where they run, and how the driver talks to them.

A child prints one JSON object a line; it ends on SIGTERM, and its last line is what it has to report.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

CHECKOUT = Path(__file__).parents[2]
_PR_SET_TIMERSLACK = 29
_END_S = 60.0


def settle(cpu: int | None, punctual: bool = False) -> None:
    """Run on `cpu` alone; `punctual`: be woken to the microsecond, before everything else on that CPU."""
    if cpu is not None:
        os.sched_setaffinity(0, {cpu})
    if punctual:
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        except PermissionError:
            pass  # a little less punctual; the report tells


def cpus() -> tuple[int | None, int | None]:
    """One for the process that is measured, another for all that surrounds it; None where there is only one."""
    cores = sorted(os.sched_getaffinity(0))
    return (cores[-1], cores[0]) if len(cores) > 1 else (None, None)


class Child:
    """A module of the benchmarks in a process of its own."""

    def __init__(self, module: str, **options: Any) -> None:
        """Start benchmarks.`module` with `--name value` for every option that is not None."""
        arguments = [f"--{name.replace('_', '-')}={value}" for name, value in options.items() if value is not None]
        self._process = subprocess.Popen(
            [sys.executable, "-m", f"benchmarks.{module}", *arguments], cwd=CHECKOUT, stdout=subprocess.PIPE, text=True
        )

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    def report(self) -> dict[str, Any]:
        """The next object it prints."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit(f"{self._process.args} ended with status {self._process.wait()}")
        return json.loads(line)

    def end(self) -> dict[str, Any]:
        """Tell it to end; what it reports."""
        self._process.send_signal(signal.SIGTERM)
        report = self.report()
        self._process.wait(_END_S)
        return report

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        assert self._process.stdout is not None
        self._process.stdout.close()
