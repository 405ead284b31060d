"""Examples as the processes that they are; and what to do where a test lacks something that pip does not bring."""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import NoReturn

import pytest

from tests.conftest import PATIENCE_S

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs" / "examples"
STAND_IN = Path(__file__).parent / "stand_in"


def lacking(what: str) -> NoReturn:
    """Skip, and say so; in CI, which installs what is needed, that would hide a test that never runs."""
    if os.environ.get("CI"):
        pytest.fail(f"{what}; .ci/run installs it")
    pytest.skip(what, allow_module_level=True)


class Lines:
    """The lines of standard output, as they come."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process
        self._lines: queue.Queue[str] = queue.Queue()
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.put(line)

    def take(self, n: int, timeout_s: float = PATIENCE_S) -> list[str]:
        return [self._lines.get(timeout=timeout_s) for _ in range(n)]

    def drain(self) -> list[str]:
        """What else came, once the process has ended."""
        self._thread.join()
        return [self._lines.get() for _ in range(self._lines.qsize())]


@contextlib.contextmanager
def python(*arguments: str | Path, **environment: str) -> Iterator[Lines]:
    """A Python process that runs until the block ends, at the latest."""
    process = subprocess.Popen(
        [sys.executable, "-W", "error", *map(str, arguments)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1", **environment},
        # Whoever runs the tests in the background of a shell hands on that SIGINT is ignored.
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )
    lines = Lines(process)
    try:
        yield lines
    finally:
        process.kill()
        process.wait()
        lines.drain()
        assert process.stdout is not None
        process.stdout.close()


def run_to_end(example: str, *arguments: str, **environment: str) -> tuple[int, list[str]]:
    """Return the exit status of an example that ends by itself, and its lines on stderr."""
    command = [sys.executable, "-W", "error", str(EXAMPLES / example), *arguments]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, **environment}, timeout=PATIENCE_S
    )
    return done.returncode, done.stderr.splitlines()


def path_with(folder: Path) -> str:
    """PYTHONPATH with `folder` before all others."""
    return os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
