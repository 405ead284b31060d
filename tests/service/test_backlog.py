"""When the loop looks less often because it cannot keep up, and when it does not."""

from __future__ import annotations

from insole_daemon.service.backlog import LONGEST_TRIAL_NS, OLD_NS, PATIENCE_NS, PAUSES_NS, TRIAL_NS, Backlog

SECOND = 1_000_000_000
CYCLE = SECOND // 50


def look(backlog, t_ns, oldest_ns):
    """One look at the time t_ns; the rest it asks for."""
    backlog.record_poll(t_ns - oldest_ns, t_ns)
    return backlog.pause_ns


def behind(backlog, t_ns):
    return look(backlog, t_ns, OLD_NS + PAUSES_NS[-1] + 1)


def on_time(backlog, t_ns):
    return look(backlog, t_ns, min(OLD_NS, CYCLE + backlog.pause_ns))


def driven(backlog, t_ns, how, until):
    """The time at which `how`, every 20 ms, brings its pause to `until`."""
    for n in range(20_000):
        if how(backlog, t_ns + n * CYCLE) == until:
            return t_ns + n * CYCLE
    raise AssertionError(f"its pause stayed {backlog.pause_ns}")


def test_on_time_it_rests_never():
    backlog = Backlog()
    assert not any(look(backlog, t, OLD_NS) for t in range(0, 5 * SECOND, CYCLE))


def test_a_pause_is_made_up_for_however_long_it_was():
    backlog = Backlog()
    on_time(backlog, 0)
    assert not look(backlog, 60 * SECOND, 60 * SECOND)
    assert not look(backlog, 60 * SECOND + 3 * CYCLE, 10 * CYCLE)


def test_a_pause_that_takes_long_to_make_up_for_is_not():
    backlog = Backlog()
    assert not look(backlog, 60 * SECOND, 60 * SECOND)
    assert not backlog.newest_only(PATIENCE_NS)
    assert backlog.newest_only(PATIENCE_NS + 1)


def test_between_pauses_the_newest_cycle_is_published():
    backlog = Backlog()
    assert not backlog.newest_only(0)
    driven(backlog, 0, behind, PAUSES_NS[1])
    assert backlog.newest_only(0)


def test_pauses_now_and_then_do_not_add_up():
    backlog = Backlog()
    for t in range(0, 60 * SECOND, SECOND):
        assert not on_time(backlog, t + CYCLE)
        assert not on_time(backlog, t + SECOND // 2)
        assert not behind(backlog, t + SECOND // 2 + OLD_NS)


def test_polls_without_cycles_cause_no_pause():
    backlog = Backlog()
    for t in range(0, 5 * SECOND, CYCLE):
        backlog.record_poll(t, t)
    assert not backlog.pause_ns


def test_a_daemon_that_is_behind_pauses_longer_each_time_and_logs_it_once():
    logged: list[str] = []
    backlog, t = Backlog(logged.append), 0
    for pause_ns in PAUSES_NS[1:]:
        t = driven(backlog, t, behind, pause_ns)
    assert t < 3 * SECOND
    assert behind(backlog, t + SECOND) == PAUSES_NS[-1]
    assert logged == ["cannot keep up with the boards: some cycles are left out, the newest is published"]


def test_on_time_again_it_is_back_at_full_rate_within_seconds():
    backlog = Backlog()
    t = driven(backlog, 0, behind, PAUSES_NS[-1])
    assert driven(backlog, t, on_time, 0) - t < (len(PAUSES_NS) - 1) * (TRIAL_NS + 2 * CYCLE)


def test_on_time_again_full_rate_is_tried_after_a_wait_that_grows_with_each_failure():
    backlog, waited = Backlog(), []
    t = driven(backlog, 0, behind, PAUSES_NS[1])
    for _ in range(9):
        tried = driven(backlog, t, on_time, 0)
        waited.append(tried - t)
        t = driven(backlog, tried, behind, PAUSES_NS[1])
    assert waited == sorted(waited)
    assert TRIAL_NS < waited[0] < 3 * TRIAL_NS
    assert LONGEST_TRIAL_NS < waited[-1] < LONGEST_TRIAL_NS + SECOND


def test_with_a_quota_only_the_newest_cycle_of_a_poll_is_published():
    backlog = Backlog()
    assert not backlog.newest_only(0)
    backlog.has_quota = True
    assert backlog.newest_only(0)
    assert backlog.pause_ns == 0
