"""The watch over several cycles at a time tells and masks what the watch itself does, and not much later."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from insole_daemon.config import Config
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.faults import InjectedFault
from insole_daemon.simulation.foot import Walk
from insole_daemon.skin.cycles import Cycles
from insole_daemon.skin.faults import DeferredFaultWatch, FaultWatch
from insole_daemon.skin.faults.deferred import GATHER_NS
from insole_daemon.skin.reader import SkinReader

CONFIG = Config()
LAYOUT = load_layout(CONFIG.insoles[0])
BOARDS = {board.address: board for board in CONFIG.insoles[0].boards}
PERIOD_NS = 20_000_000
TRIANGLE = LAYOUT.triangles[11]
FAULTS = {
    "none": [],
    "loose": [InjectedFault("loose", 1.0, None, TRIANGLE.board, TRIANGLE.triangle, chance=0.5)],
    "silent": [InjectedFault("silent", 1.0, 2.0, TRIANGLE.board)],
    "stuck": [InjectedFault("stuck", 1.0, None, TRIANGLE.board, TRIANGLE.triangle, 3)],
}


def walked(faults: Sequence[InjectedFault], seconds: float = 4.0) -> Cycles:
    frames = Emulator(CONFIG, [LAYOUT], Walk([LAYOUT], seed=3), seed=3, faults=faults).frames(0, seconds)
    (closed,) = SkinReader([LAYOUT], PERIOD_NS, 5_000_000).feed(frames)
    return Cycles.concatenate(closed, len(LAYOUT))


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_is_reported_at_most_gather_ns_later(kind):
    cycles = walked(FAULTS[kind])
    watch, deferred = FaultWatch(LAYOUT, BOARDS), DeferredFaultWatch(FaultWatch(LAYOUT, BOARDS))
    expected, reported, reported_ns = [], [], []
    for at in range(len(cycles)):
        watch.screen(cycles, at)
        expected += watch.update(cycles, at)
        deferred.take(cycles, at)
        changes = deferred.changes()
        reported += changes
        reported_ns += [int(cycles.t_ns[at]) - change.t_ns for change in changes]
    assert reported == expected[: len(reported)]
    assert len(expected) - len(reported) <= 4, "those of the last cycles, which wait for others"
    assert min(reported_ns) >= 0
    assert max(reported_ns) <= GATHER_NS + PERIOD_NS
    if kind != "none":
        assert any(change.began for change in reported)


def test_a_loose_triangle_is_masked_in_its_first_cycle():
    cycles = walked(FAULTS["loose"])
    deferred, loose_before = DeferredFaultWatch(FaultWatch(LAYOUT, BOARDS)), False
    for at in range(len(cycles)):
        deferred.take(cycles, at)
        rails = bool(np.isin(cycles.counts[at, 11], (0, 255)).all())
        assert not rails or deferred.masked[11].all()
        loose_before |= rails
        deferred.changes()
    assert loose_before


def test_changes_that_are_fetched_late_are_complete():
    cycles = walked(FAULTS["silent"])
    watch, deferred = FaultWatch(LAYOUT, BOARDS), DeferredFaultWatch(FaultWatch(LAYOUT, BOARDS))
    expected = []
    for at in range(len(cycles)):
        watch.screen(cycles, at)
        expected += watch.update(cycles, at)
        deferred.take(cycles, at)
        assert len(deferred._gathered) < 64
    assert deferred.changes() == expected


def test_a_zero_first_processes_the_gathered_cycles():
    cycles = walked([])
    deferred = DeferredFaultWatch(FaultWatch(LAYOUT, BOARDS))
    deferred.take(cycles, 0)
    deferred.zeroed()
    assert deferred._gathered == []
    deferred.take(cycles, 1)
    assert len(deferred._gathered) == 1


def test_cycles_that_are_not_due_are_worked_off_early_when_asked_to():
    cycles = walked([])
    deferred = DeferredFaultWatch(FaultWatch(LAYOUT, BOARDS))
    deferred.take(cycles, 0)
    assert not deferred.is_due
    assert deferred.changes() == []
    assert deferred.changes(early=True), "boards are heard for the first time"
    assert deferred._gathered == []


def test_cycles_are_due_after_gather_ns_and_a_fault_until_it_is_reported():
    cycles = walked([])
    deferred = DeferredFaultWatch(FaultWatch(LAYOUT, BOARDS))
    due = []
    for at in range(10):
        deferred.take(cycles, at)
        due.append(deferred.is_due)
    assert due == [*[False] * 9, True]
    deferred.zeroed()
    assert deferred.is_due
    assert deferred.changes()
    assert not deferred.is_due
