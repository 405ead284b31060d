"""A share of a CPU that a process may not exceed: the kernel's quota, or stopping and continuing where there is none."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

_V2, _V1 = Path("/sys/fs/cgroup"), Path("/sys/fs/cgroup/cpu")


@contextlib.contextmanager
def quota(pid: int, share: float, period_ms: float) -> Iterator[str]:
    """Give the process `share` of one CPU in every `period_ms` from now on; says by what means."""
    group = _group(pid, round(share * period_ms * 1000), round(period_ms * 1000))
    if group is None:
        with _duty_cycle(pid, share, period_ms * 1e-3):
            yield "SIGSTOP and SIGCONT in turn: no cgroup with a CPU quota is to be had here"
        return
    try:
        yield f"cgroup {group}"
    finally:
        _move(pid, group.parent)
        group.rmdir()


def _group(pid: int, quota_us: int, period_us: int) -> Path | None:
    """A cgroup of its own, of version 2 or 1."""
    try:
        v2 = "cpu" in (_V2 / "cgroup.subtree_control").read_text().split()
    except OSError:
        v2 = False
    group = (_V2 if v2 else _V1) / f"insole-quota-{pid}"
    try:
        group.mkdir()
        if v2:
            (group / "cpu.max").write_text(f"{quota_us} {period_us}")
        else:
            (group / "cpu.cfs_period_us").write_text(str(period_us))
            (group / "cpu.cfs_quota_us").write_text(str(quota_us))
        _move(pid, group)
    except OSError:
        with contextlib.suppress(OSError):
            group.rmdir()
        return None
    return group


def _move(pid: int, group: Path) -> None:
    (group / "cgroup.procs").write_text(str(pid))


@contextlib.contextmanager
def _duty_cycle(pid: int, share: float, period_s: float) -> Iterator[None]:
    ended = threading.Event()

    def cycle() -> None:
        while not ended.is_set():
            time.sleep(share * period_s)
            os.kill(pid, signal.SIGSTOP)
            time.sleep((1 - share) * period_s)
            os.kill(pid, signal.SIGCONT)

    thread = threading.Thread(target=cycle)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
