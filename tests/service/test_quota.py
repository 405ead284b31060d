"""A tight quota keeps all threads on one CPU."""

from __future__ import annotations

import os
import threading

import pytest

from insole_daemon.service import quota
from insole_daemon.service.quota import OneCpu, quotas_us

GROUPS = {
    "version 2": ("0::/system.slice/insole.service\n", "system.slice/insole.service/cpu.max", "4200 100000\n"),
    "version 2, a group around it": ("0::/system.slice/insole.service\n", "system.slice/cpu.max", "4200 100000\n"),
    "version 2, a container": ("0::/\n", "cpu.max", "4200 100000\n"),
    "version 1": ("9:name=systemd:/\n4:cpu,cpuacct:/one\n0::/\n", "cpu,cpuacct/one/cpu.cfs_quota_us", "4200\n"),
}


@pytest.mark.parametrize("name", GROUPS)
def test_the_quota_of_a_group_is_read(name, tmp_path):
    listed, file, text = GROUPS[name]
    (tmp_path / "groups").write_text(listed)
    (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / file).write_text(text)
    assert list(quotas_us(str(tmp_path / "groups"), str(tmp_path))) == [4200]


@pytest.mark.parametrize("text", ["max 100000\n", "-1\n", ""])
def test_a_group_without_a_quota_has_none(text, tmp_path):
    (tmp_path / "groups").write_text("0::/one\n1:cpu:/one\n")
    for file in ("one/cpu.max", "cpu/one/cpu.cfs_quota_us"):
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text(text)
    assert list(quotas_us(str(tmp_path / "groups"), str(tmp_path))) == []
    assert list(quotas_us(str(tmp_path / "nothing"), str(tmp_path))) == []


def test_all_threads_are_on_one_cpu_while_the_quota_is_tight(monkeypatch):
    before = os.sched_getaffinity(0)
    ended, ready, thread_ids = threading.Event(), threading.Event(), []

    def other_thread() -> None:
        thread_ids.append(threading.get_native_id())
        ready.set()
        ended.wait()

    thread = threading.Thread(target=other_thread)
    thread.start()
    ready.wait()
    one_cpu = OneCpu()
    try:
        for quotas, kept in (((), False), ((4200,), True), ((4200,), True), ((10**6, 10**6), False)):
            monkeypatch.setattr(quota, "quotas_us", lambda quotas=quotas: iter(quotas))
            assert one_cpu.follow() == kept
            affinities = [os.sched_getaffinity(native) for native in (0, thread_ids[0])]
            assert affinities[0] == affinities[1]
            assert affinities[0] == before if not kept else len(affinities[0]) == 1
    finally:
        ended.set()
        thread.join()
    assert os.sched_getaffinity(0) == before
