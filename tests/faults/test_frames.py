"""Frames lost, doubled, in any order, spoiled and cut, for a second: every one is counted, nothing is lost after."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.faults.matrix import numbers
from insole_daemon.bus.frames import FrameBatch
from insole_daemon.config import Config
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.load import Unloaded
from insole_daemon.skin.cycles import Cycles
from insole_daemon.skin.identifiers import TAG_B, skin_id
from insole_daemon.skin.reader import SkinReader

LEFT = Config().insoles[0]
LAYOUT = load_layout(LEFT)
FAULT_NS = (1_000_000_000, 2_000_000_000)
END_NS = 3_000_000_000
STEP_NS = 5_000_000
MARGIN_NS = 60_000_000  # three cycles: what began with the fault, and what ends after it


@pytest.fixture(scope="module")
def frames() -> FrameBatch:
    """Three seconds of the left foot, each half with the number of its tick."""
    batch = Emulator(Config(insoles=(LEFT,)), [LAYOUT], Unloaded([LAYOUT])).frames(0, END_NS * 1e-9)
    data, count = batch.data.copy(), {}
    for row, (can_id, half) in enumerate(zip(batch.can_id.tolist(), (data[:, 0] == TAG_B).tolist(), strict=True)):
        number = count[can_id, half] = count.get((can_id, half), -1) + 1
        assert numbers.write(data[row, 1:6] if half else data[row, 1:8], number)
    return replace(batch, data=data, t_mono_ns=batch.t_ns)


def mangled(batch: FrameBatch, how: str) -> tuple[FrameBatch, int]:
    """The frames with one in twenty of the second second struck; how many were."""
    random = np.random.default_rng(3)
    within = (batch.t_ns >= FAULT_NS[0]) & (batch.t_ns < FAULT_NS[1])
    hit = within & (random.random(len(batch)) < 0.05)
    rows = np.arange(len(batch))
    if how == "lost":
        return batch[~hit], int(hit.sum())
    if how == "doubled":
        return batch[np.repeat(rows, 1 + hit)], int(hit.sum())
    if how == "in any order":
        ticks = batch.t_ns // 4_000_000
        order = np.lexsort((np.where(within, random.random(len(batch)), rows), ticks))
        moved = batch[order]
        return replace(moved, t_ns=batch.t_ns, t_mono_ns=batch.t_mono_ns), 0
    if how == "spoiled":
        data = batch.data.copy()
        data[hit, 0] ^= 0x10  # neither half A nor half B
        return replace(batch, data=data), int(hit.sum())
    dlc, data = batch.dlc.copy(), batch.data.copy()
    dlc[hit], data[hit, 5:] = 5, 0
    return replace(batch, dlc=dlc, data=data), int(hit.sum())


@pytest.mark.parametrize("how", ["lost", "doubled", "in any order", "spoiled", "cut"])
def test_after_damaged_frames_nothing_is_lost_and_they_are_counted(frames, how):
    batch, struck = mangled(frames, how)
    reader = SkinReader([LAYOUT], period_ns=20_000_000, slack_ns=5_000_000)
    closed: list[Cycles] = []
    for now_ns in range(STEP_NS, END_NS, STEP_NS):
        here = (batch.t_ns > now_ns - STEP_NS) & (batch.t_ns <= now_ns)
        closed += reader.feed(batch[here])[0] + reader.advance(now_ns)[0]
    cycles = Cycles.concatenate(closed, len(LAYOUT))
    (assembler,) = reader.assemblers
    assembler.settle()
    refused = reader.streams.refused
    accounted = int(assembler.arrivals.sum()) + refused.bad_dlc + refused.unknown_tag
    assert accounted == np.count_nonzero(batch.t_ns <= now_ns), "every frame is used or refused"
    assert refused.bad_dlc == (struck if how == "cut" else 0)
    assert refused.unknown_tag == (struck if how == "spoiled" else 0)
    healthy = (batch.t_ns < FAULT_NS[0] - MARGIN_NS) | (batch.t_ns > FAULT_NS[1] + MARGIN_NS)
    rows = np.flatnonzero(healthy & (batch.t_ns < END_NS - MARGIN_NS))
    halves = (batch.data[:, 0] == TAG_B).astype(int)
    for half, counts in enumerate((slice(0, 7), slice(7, 12))):
        published = numbers.read(cycles.counts[..., counts])
        for row, triangle in enumerate(LAYOUT.triangles):
            same_half = rows[
                (batch.can_id[rows] == skin_id(triangle.board, triangle.triangle)) & (halves[rows] == half)
            ]
            sent = numbers.read(batch.data[same_half, 1 : 6 if half else 8])
            assert len(sent) > 80
            assert np.isin(sent, published[:, row]).all(), f"nothing of {triangle} is lost"
