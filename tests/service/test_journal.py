"""The daemon's log: everything new at once, nothing over and over."""

from __future__ import annotations

import logging
import re

from insole_daemon.service.journal import QUIET_NS, Journal


def journal(caplog):
    now = [0]
    caplog.set_level(logging.INFO, logger="journal")
    return Journal(logging.getLogger("journal"), lambda: now[0]), now


def test_a_bus_that_flaps_for_a_minute_is_logged_a_few_times_with_the_count(caplog):
    log, now = journal(caplog)
    n_events = 0
    for now[0] in range(0, 6 * QUIET_NS, 50_000_000):
        log.tell(logging.WARNING, "the controller has left the bus")
        log.tell(logging.INFO, "the controller is back on the bus")
        n_events += 2
        if now[0] % 1_000_000_000 == 0:
            log.sum_up()
    now[0] += QUIET_NS
    log.sum_up()
    lines = [record.getMessage() for record in caplog.records]
    assert len(lines) <= 16
    held_back = sum(int(again.group(1)) for text in lines if (again := re.match(r"(\d+) times more in 10 s: ", text)))
    assert held_back + 2 == n_events, "each one is said or counted"
    assert {record.levelno for record in caplog.records} == {logging.WARNING, logging.INFO}


def test_new_events_are_logged_at_once_and_again_after_a_pause(caplog):
    log, now = journal(caplog)
    log.tell(logging.INFO, "up")
    log.tell(logging.INFO, "down")
    log.sum_up()
    now[0] = QUIET_NS
    log.sum_up()
    log.tell(logging.INFO, "up")
    log.tell(logging.INFO, "up")
    now[0] += QUIET_NS
    log.sum_up()
    assert [record.getMessage() for record in caplog.records] == ["up", "down", "up", "once more in 10 s: up"]
