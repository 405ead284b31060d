"""The daemon as a process: readiness, the watchdog, the end, and what it publishes when boards are slow or gone."""

from __future__ import annotations

import itertools
import socket
import time

import numpy as np
import pytest

import insole_daemon
from insole_daemon.errors import WireError
from insole_daemon.wire.session import open_session
from tests.conftest import one_of_five


def test_sigterm_ends_it_cleanly_within_a_second(daemon):
    with daemon.boards():
        time.sleep(0.5)
        status, took = daemon.end()
    assert status == 0
    assert took < 1.0


def test_service_manager_is_told(daemon, tmp_path):
    daemon.end()
    manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    manager.bind(str(tmp_path / "notify"))
    manager.settimeout(5)
    daemon.environment = {"NOTIFY_SOCKET": str(tmp_path / "notify")}
    daemon.start()
    told = manager.recv(4096).decode()
    assert "READY=1" in told
    with daemon.boards():
        alive = manager.recv(4096).decode()
        alive = manager.recv(4096).decode()
    assert "WATCHDOG=1" in alive
    assert "left 5" in alive or "left 4" in alive, "the status says the rate"
    daemon.end()
    last = ""
    while "STOPPING=1" not in last:
        last = manager.recv(4096).decode()
    manager.close()


def test_boards_told_50_ms_repeat_at_50_hz_and_subscribers_see_it(daemon):
    with daemon.boards(period_ms=50, seed=1), insole_daemon.connect(daemon.endpoint) as insole:
        wrenches, healths = insole.wrenches("left"), insole.healths("left")
        # Once all have come twice nobody waits for them any more.
        next(w for w in wrenches if w.repeated and w.valid[:, 0].any())

        def measure():
            got = list(itertools.islice(wrenches, 150))
            health = next(h for h in healths if h.t_ns > got[-1].t_published_ns)
            assert not any(w.lost for w in got)
            rates_hz = [board["rate_hz"] for board in health.boards]
            return {
                "valid": np.mean([w.valid[:, 0].any() for w in got]),  # boards that get no CPU are silent
                "published_ms": np.median(np.diff([w.t_published_ns for w in got])) * 1e-6,
                "repeated": np.mean([w.repeated for w in got]),
                "oldest_ms": max(float(w.age_ms.max()) for w in got),
                "slowest_hz": min(rates_hz),
                "fastest_hz": max(rates_hz),
                "publish_hz": health.publish_rate_hz,
            }

        one_of_five(
            measure,
            valid=(0.999, 1.001),
            published_ms=(19, 21),
            repeated=(0.1, 0.7),  # three boards, whose phases leave 32 ms free
            oldest_ms=(35, 75),
            slowest_hz=(19, 21),
            fastest_hz=(19, 21),
            publish_hz=(49, 51),
        )


def test_a_missing_board_is_marked_and_does_not_slow_the_others(daemon):
    with daemon.boards(left_out=(6,)), insole_daemon.connect(daemon.endpoint) as insole:
        missing = np.array([t["board"] == 6 for t in insole.meta("left").triangles])
        healths = insole.healths("left")
        next(healths)
        wrenches = insole.wrenches("left")

        def measure():
            got = list(itertools.islice(wrenches, 100))
            for w in got:
                assert not w.lost
                assert not w.valid[missing].any()
                assert np.isnan(w.age_ms[missing]).all()
                assert w.valid_fraction < 1
            return {
                "valid": np.mean([w.valid[~missing].any() for w in got]),
                "rate_hz": 99e9 / (got[-1].t_ns - got[0].t_ns),
            }

        one_of_five(measure, valid=(0.999, 1.001), rate_hz=(49, 51))
        health = next(healths)
    assert health.state == "degraded"
    assert {b["address"]: b["state"] for b in health.boards} == {5: "streaming", 6: "never seen", 7: "streaming"}


def test_boards_that_fall_silent_leave_no_force_behind(daemon):
    with insole_daemon.connect(daemon.endpoint) as insole:
        events = insole.events("left")
        with daemon.boards():
            time.sleep(2.2)
        wrenches = insole.wrenches("left")
        last = next(w for w in wrenches if w.valid_fraction == 0)
        of_boards = (event for event in events if event.boards)  # steps are told as well
        told = [next(of_boards) for _ in range(6)]
    assert last.f_z_n is None
    assert last.cop_x_m is None
    assert last.repeated
    assert [event.kind for event in told] == ["board_streaming"] * 3 + ["board_silent"] * 3
    assert {event.boards[0] for event in told[3:]} == {5, 6, 7}


def test_zenoh_port_taken_is_said(daemon):
    with pytest.raises(WireError, match="already in use.*zenoh.listen"):
        open_session("peer", [daemon.endpoint])
