"""When cycles are left out because the loop cannot keep up, and when they are not."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from insole_daemon.service.backlog import BEHIND_NS, PATIENCE_NS, Backlog

SECOND = 1_000_000_000


def closed(*times_ns):
    return [SimpleNamespace(t_mono_ns=[t_ns]) for t_ns in times_ns]


def test_on_time_nothing_is_left_out():
    backlog = Backlog()
    assert not any(backlog.newest_only(closed(t - BEHIND_NS, t), t) for t in range(0, 2 * SECOND, SECOND // 50))


def test_a_pause_is_made_up_for_however_long_it_was():
    backlog = Backlog()
    assert not backlog.newest_only(closed(0), 5 * SECOND)
    assert not backlog.newest_only(closed(4 * SECOND), 5 * SECOND + PATIENCE_NS)


def test_who_is_behind_for_long_leaves_cycles_out_until_it_is_on_time():
    backlog = Backlog()
    for t_ns in range(SECOND, 2 * SECOND, SECOND // 50):
        left_out = backlog.newest_only(closed(t_ns - BEHIND_NS - 1, t_ns), t_ns)
        assert left_out == (t_ns - SECOND > PATIENCE_NS)
    assert not backlog.newest_only(closed(2 * SECOND), 2 * SECOND)
    assert not backlog.newest_only(closed(2 * SECOND), 3 * SECOND), "its patience begins anew"


@pytest.mark.parametrize("now_ns", [0, SECOND])
def test_where_nothing_closed_nothing_is_behind(now_ns):
    assert not Backlog().newest_only([], now_ns)
