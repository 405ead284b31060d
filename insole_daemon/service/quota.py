"""Keep the process on one CPU while its CPU time is limited tightly, by systemd's CPUQuota= or a container's limit.

The kernel gives a quota to the CPUs in slices of 5 ms. With less than one for each CPU, the CPU that runs first may
take all of it, and a thread on another one waits for the next period: a message that the loop has put then waits for up
to 0.1 s in Zenoh's sending thread. On one CPU all threads share the slice.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
from collections.abc import Iterator

_SLICE_US = 5000  # sched_cfs_bandwidth_slice_us
_NO_QUOTA = ("max", "-1")

_libc = ctypes.CDLL(None)


class OneCpu:
    """Moves all threads of the process to the CPU of the calling one while the quota is tight, and back afterwards."""

    def __init__(self) -> None:
        self._cpus = os.sched_getaffinity(0)
        self._is_kept = False

    def follow(self) -> bool:
        """Return whether the quota is tight; where it has become so, or is no longer, move the threads."""
        is_tight = min(quotas_us(), default=_SLICE_US * len(self._cpus)) < _SLICE_US * len(self._cpus)
        if is_tight != self._is_kept:
            self._is_kept = is_tight
            cpus = {_libc.sched_getcpu()} if is_tight else self._cpus
            for thread in os.listdir("/proc/self/task"):
                with contextlib.suppress(OSError):  # it has ended, or a sandbox refuses
                    os.sched_setaffinity(int(thread), cpus)
        return is_tight


def quotas_us(groups: str = "/proc/self/cgroup", root: str = "/sys/fs/cgroup") -> Iterator[int]:
    """Yield the quotas of the process's control group and of all around it, in µs of each period.

    `groups` and `root`: the list of the process's groups, and the folder in which they are.
    """
    for line in _text(groups).splitlines():
        _, controllers, group = line.split(":", 2)  # version 2 names no controllers
        if controllers and "cpu" not in controllers.split(","):
            continue
        name = "cpu.cfs_quota_us" if controllers else "cpu.max"
        while True:
            quota, *_ = (*_text(f"{root}/{controllers}{group}/{name}").split(), "max")
            if quota not in _NO_QUOTA:
                yield int(quota)
            if group == "/":
                break
            group = os.path.dirname(group)


def _text(file: str) -> str:
    """Return what is in `file`; nothing where it is not there."""
    try:
        with open(file) as opened:
            return opened.read()
    except OSError:
        return ""
