"""Scheduling policy of the threads beside the main loop."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator


@contextlib.contextmanager
def batch_threads() -> Iterator[None]:
    """Start threads within this context with the policy SCHED_BATCH, so that they do not preempt the calling thread.

    Each `put` wakes Zenoh's sending thread twice. With the ordinary policy it preempts the loop six times a cycle while
    that is publishing. With SCHED_BATCH it runs when the loop sleeps, or on another CPU, and sends all messages in one
    packet. A real-time policy is kept, because threads of one priority do not preempt each other. If a sandbox refuses
    the call, the ordinary policy is used.
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
