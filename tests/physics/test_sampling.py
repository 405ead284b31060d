"""Converters that run by themselves, jitter, and losses."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.physics.sampling import CDC_HZ, held, jittered_s, lost, sequence, taken_s


def test_a_converter_is_27_hz_and_no_sample_is_older_than_its_sequence() -> None:
    t_s = np.arange(0, 60, 0.02)
    phase_s = np.array([0.0, 0.01, 0.03])
    taken = taken_s(t_s, phase_s)
    assert taken.shape == (3000, 3)
    age = t_s[:, None] - taken
    assert age.min() >= -1e-12
    assert age.max() < 36.864e-3
    assert len(np.unique(sequence(t_s, phase_s)[:, 0])) / 60 == pytest.approx(CDC_HZ, abs=0.05)
    assert pytest.approx(27.127, abs=1e-3) == CDC_HZ


def test_sequences_by_hand() -> None:
    t_s = np.array([0.0, 0.0099, 0.01, 0.109, 0.11])
    assert sequence(t_s, 0.01, 10.0).tolist() == [-1, -1, 0, 0, 1]
    assert taken_s(t_s, 0.01, 10.0) == pytest.approx([-0.09, -0.09, 0.01, 0.01, 0.11])


def test_jitter_is_late_and_in_order() -> None:
    t_s = np.arange(20_000) * 0.02
    stamps = jittered_s(t_s, 1e-3, np.random.default_rng(0))
    assert (stamps >= t_s).all()
    assert (np.diff(stamps) >= 0).all()
    assert np.sqrt(((stamps - t_s) ** 2).mean()) == pytest.approx(1e-3, rel=0.03)


@pytest.mark.parametrize(("share", "run"), [(0.02, 1.0), (0.1, 5.0), (0.4, 3.0)])
def test_losses_have_their_share_in_runs_of_their_length(share: float, run: float) -> None:
    missing = lost(200_000, share, run, np.random.default_rng(1))
    assert missing.mean() == pytest.approx(share, rel=0.1)
    ends = (missing[:-1] & ~missing[1:]).sum()
    assert missing.sum() / ends == pytest.approx(run, rel=0.1)


def test_losses_that_cannot_be() -> None:
    with pytest.raises(ValueError, match="share below 1 in runs of at least 1, found 0.9 in runs of 1"):
        lost(10, 0.9, 1.0, np.random.default_rng(0))


def test_what_is_lost_repeats_what_came_last() -> None:
    x = np.arange(5.0)[:, None] * [1, 10]
    assert held(x, np.array([False, True, True, False, True]))[:, 1].tolist() == [0, 0, 0, 30, 30]
