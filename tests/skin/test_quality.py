"""The verdict on cycles: what is expected by the clock, and the three words."""

from __future__ import annotations

import time

import pytest

from insole_daemon.config import Board
from insole_daemon.skin.quality import Quality, QualityWindow, period_ns_of

PERIOD_NS = 20_000_000
SECOND_NS = 1_000_000_000


@pytest.mark.parametrize(
    ("received", "verdict"),
    [(500, "good"), (495, "good"), (494, "usable"), (475, "usable"), (474, "not usable"), (0, "not usable")],
)
def test_the_verdict_follows_the_share(received, verdict):
    quality = Quality.over(10 * SECOND_NS, PERIOD_NS, received, 0, 0)
    assert quality.expected == 500
    assert quality.skipped == 500 - received
    assert quality.verdict == verdict
    assert quality.document()["share"] == pytest.approx(received / 500)


def test_a_starved_daemon_that_loses_no_message_is_not_usable():
    quality = Quality.over(20 * SECOND_NS, PERIOD_NS, 78, 0, 30)  # 3.9 Hz
    assert quality.verdict == "not usable"
    assert quality.sentence == "not usable: 78 of 1000 cycles (7.8 %), 922 skipped, 30 late"


def test_repeats_are_neither_received_nor_skipped():
    quality = Quality.over(10 * SECOND_NS, PERIOD_NS, 400, 100, 0)
    assert (quality.expected, quality.skipped, quality.share) == (500, 0, 0.8)


def test_one_cycle_across_the_edge_is_not_missing():
    assert Quality.over(SECOND_NS, PERIOD_NS, 49, 0, 0).verdict == "good"
    assert Quality.over(SECOND_NS, PERIOD_NS, 48, 0, 0).verdict == "usable"


def test_boards_configured_to_a_longer_period_are_expected_less_often():
    boards = [Board(address=address, interface="can0", period_ms=50) for address in (5, 6)]
    assert period_ns_of(boards) == 50_000_000
    assert period_ns_of([]) == PERIOD_NS
    quality = Quality.over(10 * SECOND_NS, period_ns_of(boards), 200, 300, 0)
    assert (quality.expected, quality.verdict) == (200, "good")


def test_no_cycle_is_not_usable():
    quality = Quality.over(0, PERIOD_NS, 0, 0, 0)
    assert (quality.share, quality.verdict, quality.sentence) == (0.0, "not usable", "not usable: no cycle")


def test_a_written_document_reads_back_the_same():
    quality = Quality.over(10 * SECOND_NS, PERIOD_NS, 480, 5, 2)
    assert Quality.of(quality.document()) == quality


def test_the_window_forgets_what_is_older_than_ten_seconds():
    window = QualityWindow(PERIOD_NS)
    verdicts, began_ns = [], time.monotonic_ns()
    for second in range(30):
        for cycle in range(50):
            if not (second == 5 and cycle >= 20):  # 30 of 500 are lost, 6 %
                window.count(late=False, repeated=False)
        verdicts.append(window.report(began_ns + (second + 1) * SECOND_NS).verdict)
    assert verdicts == ["good"] * 5 + ["not usable"] * 10 + ["good"] * 15
