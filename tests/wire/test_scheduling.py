"""Threads that a daemon's session starts do not preempt the loop that publishes."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import pytest

from insole_daemon.wire.scheduling import batch_threads

# In a process of its own: Zenoh starts its threads once a process, here those of another test.
_OPEN = """
import os, sys
from insole_daemon.config import Zenoh
from insole_daemon.wire.session import open_daemon_session

before = os.listdir("/proc/self/task")
with open_daemon_session(Zenoh(listen=("tcp/127.0.0.1:0",))) as session:
    session.put("insole/test", b"")
    policies = {os.sched_getscheduler(int(thread)) for thread in os.listdir("/proc/self/task") if thread not in before}
    assert policies == {os.SCHED_BATCH}, policies
    assert os.sched_getscheduler(0) == os.SCHED_OTHER
"""


def policy_of_new_thread() -> int:
    policies: list[int] = []
    thread = threading.Thread(target=lambda: policies.append(os.sched_getscheduler(0)))
    thread.start()
    thread.join()
    return policies[0]


def test_zenohs_threads_run_as_batch_and_the_loop_as_before() -> None:
    done = subprocess.run([sys.executable, "-c", _OPEN], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_only_threads_started_within_are_batch() -> None:
    with batch_threads():
        assert policy_of_new_thread() == os.SCHED_BATCH
    assert policy_of_new_thread() == os.SCHED_OTHER


def test_an_error_within_leaves_the_policy_as_it_was() -> None:
    with pytest.raises(ValueError, match="within"), batch_threads():
        raise ValueError("within")
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


def test_a_real_time_policy_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    monkeypatch.setattr(os, "sched_getscheduler", lambda pid: os.SCHED_FIFO)
    monkeypatch.setattr(os, "sched_setscheduler", lambda pid, policy, parameters: calls.append(policy))
    with batch_threads():
        pass
    assert not calls


def test_a_sandbox_that_refuses_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(pid: int, policy: int, parameters: os.sched_param) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with batch_threads():
        assert policy_of_new_thread() == os.SCHED_OTHER
