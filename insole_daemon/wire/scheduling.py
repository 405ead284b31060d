"""How the kernel schedules the threads beside the loop."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator


@contextlib.contextmanager
def batch_threads() -> Iterator[None]:
    """Within it, threads start with the policy SCHED_BATCH: they do not preempt the calling thread.

    Each `put` wakes Zenoh's sending thread twice. On the loop's CPU it ran at once, six times a cycle, in the midst of
    the publishing; now it runs when the loop sleeps, or on another CPU, and sends all messages in one packet. A
    real-time policy stays as it is: threads of one priority do not preempt each other. Where a sandbox refuses the
    call, everything works with the ordinary policy.
    """
    ordinary = os.sched_getscheduler(0) == os.SCHED_OTHER
    if ordinary:
        _set_policy(os.SCHED_BATCH)
    try:
        yield
    finally:
        if ordinary:
            _set_policy(os.SCHED_OTHER)


def _set_policy(policy: int) -> None:
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, policy, os.sched_param(0))
