"""Free-running converters, jitter, and losses."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.physics.draws import Drawn, Draws
from insole_daemon.physics.sampling import CDC_HZ, Jitter, Losses, conversion_time_s, draw_phases_s, sequence_number


def test_a_converter_runs_at_27_hz_and_no_sample_is_older_than_one_sequence() -> None:
    t_s = np.arange(0, 60, 0.02)
    phase_s = np.array([0.0, 0.01, 0.03])
    conversions_s = conversion_time_s(t_s, phase_s)
    assert conversions_s.shape == (3000, 3)
    age = t_s[:, None] - conversions_s
    assert age.min() >= -1e-12
    assert age.max() < 36.864e-3
    assert len(np.unique(sequence_number(t_s, phase_s)[:, 0])) / 60 == pytest.approx(CDC_HZ, abs=0.05)
    assert pytest.approx(27.127, abs=1e-3) == CDC_HZ


def test_sequence_numbers_equal_hand_computed_values() -> None:
    t_s = np.array([0.0, 0.0099, 0.01, 0.109, 0.11])
    assert sequence_number(t_s, 0.01, 10.0).tolist() == [-1, -1, 0, 0, 1]
    assert conversion_time_s(t_s, 0.01, 10.0) == pytest.approx([-0.09, -0.09, 0.01, 0.01, 0.11])


def test_converters_have_different_phases() -> None:
    phases = draw_phases_s(0, 5)
    assert len(np.unique(phases)) == 16
    assert phases.min() >= 0
    assert phases.max() < 1 / CDC_HZ
    assert (draw_phases_s(0, 6) != phases).all()


def test_jitter_is_half_normal_and_continues_between_calls() -> None:
    whole = Jitter(1e-3, 0, 5).draw_delays_s(20_000)
    assert whole.min() >= 0
    assert np.sqrt((whole**2).mean()) == pytest.approx(1e-3, rel=0.03)
    pieces = Jitter(1e-3, 0, 5)
    np.testing.assert_array_equal(np.concatenate([pieces.draw_delays_s(7), pieces.draw_delays_s(93)]), whole[:100])


@pytest.mark.parametrize(("share", "run"), [(0.02, 1.0), (0.1, 5.0), (0.4, 3.0), (0.5, 1.0)])
def test_losses_have_the_given_share_and_mean_run(share: float, run: float) -> None:
    missing = Losses(share, run, 1, 5).draw_losses(200_000)
    assert missing.mean() == pytest.approx(share, rel=0.1)
    ends = (missing[:-1] & ~missing[1:]).sum()
    assert missing.sum() / ends == pytest.approx(run, rel=0.1)


@pytest.mark.parametrize(("share", "run"), [(0.1, 5.0), (0.7, 4.0), (0.0, 1.0)])
def test_losses_equal_a_state_by_state_gilbert_chain(share: float, run: float) -> None:
    luck = Draws(3, Drawn.LOSSES, 5)
    lost, expected = bool(luck.uniform(1)[0] < share), []
    for draw in luck.uniform(5000):
        expected.append(lost)
        lost = draw < 1 - 1 / run if lost else draw < share / (run * (1 - share))
    pieces = Losses(share, run, 3, 5)
    assert np.concatenate([pieces.draw_losses(n) for n in (1, 0, 999, 4000)]).tolist() == expected
