"""Late and lost frames of simulated boards are compared with their laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insole_daemon.bus.frames import FrameBatch
from insole_daemon.config import Config
from insole_daemon.errors import SimulationError
from insole_daemon.physics.chain import Chain
from insole_daemon.physics.effect import Effect, Where, effect
from insole_daemon.physics.sampling import Losses
from insole_daemon.simulation.trial import Trial
from insole_daemon.skin.layout import builtin

LEFT = builtin("left", (5, 6, 7))
ONE_FOOT = replace(Config(), insoles=Config().insoles[:1])
ONE_BOARD = Where("board", ((6,),))


def frames(*effects: Effect, seed: int = 3) -> FrameBatch:
    trial = Trial("stand", ONE_FOOT, [LEFT], effects={"left": effects}, seed=seed)
    return trial.emulator.frames(0, 4.0)


def of(batch: FrameBatch, board: int) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    return (batch.can_id >> 4 & 0xF) == board


def test_lost_frames_are_those_drawn_from_the_seed() -> None:
    sent, received = frames(), frames(effect("loss", ONE_BOARD, share=0.2, run=4.0))
    lost = np.zeros(len(sent), bool)
    lost[of(sent, 6)] = Losses(0.2, 4.0, 3, 6).draw_losses(int(of(sent, 6).sum()))
    assert 0.1 < lost[of(sent, 6)].mean() < 0.3
    np.testing.assert_array_equal(received.t_ns, sent.t_ns[~lost])
    np.testing.assert_array_equal(received.data, sent.data[~lost])


def test_chain_and_board_lose_the_same_frames() -> None:
    sent = frames()
    ticks = int(of(sent, 6).sum()) // (2 * sum(t.board == 6 for t in LEFT.triangles))
    trial = Trial("stand", ONE_FOOT, [LEFT], seed=3)
    load = np.cumsum(np.ones((ticks, 28, 12)), axis=0)
    chain = Chain([effect("loss", ONE_BOARD, share=0.2, run=4.0)], LEFT, trial.insoles[0].calibration, seed=3)
    exact = Chain([], LEFT, trial.insoles[0].calibration).forward()(load, np.arange(ticks) * 0.02)
    missing = chain.forward()(load, np.arange(ticks) * 0.02) != exact
    rows = [row for row, triangle in enumerate(LEFT.triangles) if triangle.board == 6]
    rows.sort(key=lambda row: LEFT.triangles[row].triangle)
    halves = missing[:, rows][..., [0, 7]]
    expected = Losses(0.2, 4.0, 3, 6).draw_losses(halves.size).reshape(halves.shape)
    np.testing.assert_array_equal(halves[1:], expected[1:], "the first reading stands for what was told before")


def test_jitter_delays_stamps_and_keeps_frames() -> None:
    sent, received = frames(), frames(effect("jitter", ONE_BOARD, std_s=0.002))
    np.testing.assert_array_equal(received.can_id, sent.can_id)
    np.testing.assert_array_equal(received.data, sent.data)
    late_s = (received.t_ns - sent.t_ns) * 1e-9
    assert (np.diff(received.t_ns) >= 0).all()
    assert late_s.min() >= 0
    assert 0.001 < late_s[of(sent, 6)].mean() < 0.004


def test_the_same_seed_gives_the_same_reception() -> None:
    made = [effect("jitter", std_s=0.001), effect("loss", share=0.05, run=2.0)]
    first, again, other = frames(*made), frames(*made), frames(*made, seed=4)
    np.testing.assert_array_equal(first.t_ns, again.t_ns)
    assert len(first) != len(other) or (first.t_ns != other.t_ns).any()


def test_converters_run_at_the_rate_of_the_effect() -> None:
    def repeats(batch: FrameBatch, board: int) -> float:
        triangle = min(t.triangle for t in LEFT.triangles if t.board == board)
        mine = batch[of(batch, board) & (batch.data[:, 0] == 0x40) & ((batch.can_id & 0xF) == triangle)].data
        return float((mine[1:] == mine[:-1]).all(axis=1).mean())

    received = frames(effect("sample_and_hold", ONE_BOARD, rate_hz=10.0))
    assert repeats(received, 6) == pytest.approx(0.8, abs=0.03), "at 50 Hz four of five readings are old"
    assert repeats(received, 5) < 0.1


def test_two_loss_effects_on_one_board_are_refused() -> None:
    made = [effect("loss", share=0.1, run=1.0), effect("loss", ONE_BOARD, share=0.2, run=1.0)]
    with pytest.raises(SimulationError, match="loss: where.ids: expected each board once, found board 6 twice"):
        frames(*made)
