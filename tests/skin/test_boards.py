"""How often boards send, how often there is something new, and which of them are there."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.skin.assembler import CycleAssembler
from insole_daemon.skin.boards import BoardReport, BoardSurvey
from insole_daemon.skin.layout import builtin

MS = 1_000_000
LAYOUT = builtin("left", (5, 6, 7))
N = len(LAYOUT)
BOARD = np.repeat(LAYOUT.identities[:, 0], 2)  # of every slot
STALE = 200 * MS
START = 5_000 * MS


class Bench:
    """Boards that send into an assembler, each with a period and with something new so often."""

    def __init__(self) -> None:
        self.assembler = CycleAssembler(LAYOUT.identities[:, 0], 20 * MS, 5 * MS)
        self.survey = BoardSurvey(LAYOUT)
        self.now_ns = START
        assert [report.state for report in self.survey(self.assembler, self.now_ns, STALE)] == ["never seen"] * 3

    def run(self, seconds: float, period_ms: dict[int, float], new_every_ms: float = 1.0) -> dict[int, BoardReport]:
        """The reports after `seconds` of it."""
        end_ns = self.now_ns + round(seconds * 1e9)
        slots, sample, t_ns = [np.empty(0, np.int64)], [np.empty(0, np.int64)], [np.empty(0, np.int64)]
        for address, period in period_ms.items():
            ticks = np.arange(self.now_ns + address * MS, end_ns, round(period * MS))
            own = np.flatnonzero(address == BOARD)
            slots.append(np.tile(own, len(ticks)))
            sample.append(np.repeat((ticks - START) // round(new_every_ms * MS), len(own)))
            t_ns.append((ticks[:, None] + 100_000 * np.arange(len(own))).ravel())
        t = np.concatenate(t_ns)
        order = np.argsort(t, kind="stable")
        data = np.concatenate(sample)[order].view(np.uint8).reshape(-1, 8)
        self.assembler.feed(np.concatenate(slots)[order].astype(np.int16), data, t[order], t[order])
        self.now_ns = end_ns
        self.assembler.advance(end_ns)
        return {report.address: report for report in self.survey(self.assembler, end_ns, STALE)}


def test_a_board_with_a_period_of_50_ms_is_distinguished() -> None:
    reports = Bench().run(2.0, {5: 20, 6: 50, 7: 20})
    assert list(reports) == [5, 6, 7]
    assert {report.state for report in reports.values()} == {"streaming"}
    assert [reports[address].rate_hz for address in (5, 6, 7)] == pytest.approx([50, 20, 50], abs=0.6)
    assert [reports[address].change_rate_hz for address in (5, 6, 7)] == pytest.approx([50, 20, 50], abs=0.6)
    assert reports[6].missed == 3 * 2 * 5, "of five triangles both halves, until they are given up"


def test_values_of_27_hz_sent_at_50_hz_are_distinguished() -> None:
    reports = Bench().run(4.0, dict.fromkeys((5, 6, 7), 20.0), new_every_ms=36.864)
    for report in reports.values():
        assert report.rate_hz == pytest.approx(50, abs=0.3)
        assert report.change_rate_hz == pytest.approx(1000 / 36.864, abs=0.3)


def test_rates_are_those_since_the_survey_before() -> None:
    bench = Bench()
    bench.run(1.0, dict.fromkeys((5, 6, 7), 50.0))
    reports = bench.run(2.0, dict.fromkeys((5, 6, 7), 20.0))
    assert [report.rate_hz for report in reports.values()] == pytest.approx([50] * 3, abs=0.6)


def test_the_first_survey_has_no_rates() -> None:
    assembler = CycleAssembler(LAYOUT.identities[:, 0], 20 * MS, 5 * MS)
    slots = np.arange(2 * N)
    assembler.feed(slots.astype(np.int16), np.ones((2 * N, 8), np.uint8), START + slots, START + slots)
    reports = BoardSurvey(LAYOUT)(assembler, START + MS, STALE)
    assert {report.state for report in reports} == {"streaming"}
    assert max(report.rate_hz + report.change_rate_hz for report in reports) < 1e-6


def test_silent_is_longer_than_stale() -> None:
    bench = Bench()
    bench.run(1.0, dict.fromkeys((5, 6, 7), 20.0))
    reports = bench.run(0.15, {5: 20, 7: 20})
    assert reports[6].state == "streaming"
    reports = bench.run(0.15, {5: 20, 7: 20})
    assert [reports[address].state for address in (5, 6, 7)] == ["streaming", "silent", "streaming"]
    assert reports[6].rate_hz == 0
    assert reports[6].change_rate_hz == 0
    assert reports[6].age_ms == pytest.approx(300 + 20 - 6 - 0.9, abs=0.5)
    assert reports[5].age_ms is not None
    assert reports[5].age_ms < 20
    assert reports[6].missed == 3 * 2 * 5
    assert bench.run(0.1, dict.fromkeys((5, 6, 7), 20.0))[6].state == "streaming"


def test_never_seen() -> None:
    reports = Bench().run(1.0, {5: 20, 6: 20})
    assert reports[7] == BoardReport(7, "never seen", 0.0, 0.0, None, missed=3 * 2 * 11)
    assert reports[5].missed == reports[6].missed == 0


def test_one_triangle_of_a_board_that_is_not_there_changes_no_rate() -> None:
    """A loose triangle sends nothing; the board is still as fast as the others say."""
    assembler = CycleAssembler(LAYOUT.identities[:, 0], 20 * MS, 5 * MS)
    survey = BoardSurvey(LAYOUT)
    survey(assembler, START, STALE)
    slots = np.tile(np.arange(2, 2 * N), 50)
    t_ns = START + np.repeat(np.arange(50), 2 * N - 2) * 20 * MS + slots * 100_000
    assembler.feed(slots.astype(np.int16), np.ones((len(slots), 8), np.uint8), t_ns, t_ns)
    front, *_ = survey(assembler, START + 1_000 * MS, STALE)
    assert front.rate_hz == pytest.approx(50)
    assert front.missed == 3 * 2
