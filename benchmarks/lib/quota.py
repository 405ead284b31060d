"""A share of one CPU that a process may not exceed: the kernel's quota, or stopping it where there is none."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Self

_V2, _V1 = Path("/sys/fs/cgroup"), Path("/sys/fs/cgroup/cpu")
_MUCH = ("cpu.weight", "10000"), ("cpu.shares", "102400")  # of both versions; what else runs does not count then
_LEAST_US = 1000  # of a quota


class Group:
    """A control group for the process `pid`, in which it gets all that its quota allows, however busy the host is."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._folder: Path | None = None
        self._ended, self._thread = threading.Event(), threading.Thread()
        try:
            self._v2 = "cpu" in (_V2 / "cgroup.subtree_control").read_text().split()
        except OSError:
            self._v2 = False
        folder = (_V2 if self._v2 else _V1) / f"insole-quota-{pid}"
        with contextlib.suppress(OSError):
            folder.mkdir()
            self._folder = folder
            name, value = _MUCH[0 if self._v2 else 1]
            (folder / name).write_text(value)
            (folder / "cgroup.procs").write_text(str(pid))

    def limit(self, share: float, period_ms: float) -> str:
        """From now on `share` of a CPU in every `period_ms`, or in longer ones if quotas need that; says how."""
        period_ms = max(period_ms, _LEAST_US / share / 1000)
        quota_us, period_us = round(share * period_ms * 1000), round(period_ms * 1000)
        said = f"{100 * share:.1f} % of a CPU, {quota_us / 1000:.1f} ms in every {period_ms:.0f} ms"
        if self._folder is None:
            self._stop_in_turn(share, period_ms * 1e-3)
            return f"{said}, by SIGSTOP and SIGCONT in turn since there is no control group with a quota here"
        if self._v2:
            (self._folder / "cpu.max").write_text(f"{quota_us} {period_us}")
        else:
            (self._folder / "cpu.cfs_quota_us").write_text("-1")
            (self._folder / "cpu.cfs_period_us").write_text(str(period_us))
            (self._folder / "cpu.cfs_quota_us").write_text(str(quota_us))
        return said

    def _stop_in_turn(self, share: float, period_s: float) -> None:
        self._end_thread()

        def cycle() -> None:
            while not self._ended.is_set():
                time.sleep(share * period_s)
                os.kill(self._pid, signal.SIGSTOP)
                time.sleep((1 - share) * period_s)
                os.kill(self._pid, signal.SIGCONT)

        self._thread = threading.Thread(target=cycle)
        self._thread.start()

    def _end_thread(self) -> None:
        if self._thread.is_alive():
            self._ended.set()
            self._thread.join()
        self._ended.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Without limits again."""
        self._end_thread()
        if self._folder is not None:
            with contextlib.suppress(ProcessLookupError):  # it has ended
                (self._folder.parent / "cgroup.procs").write_text(str(self._pid))
            self._folder.rmdir()
