"""A rising baseline is followed, a load is not."""

from __future__ import annotations

import numpy as np

from insole_daemon.calibration.baseline_drift import baseline_rise_count

REST = np.array([240.0, 238.0, 241.0, 239.0, 240.5, 242.0])
BOARD = np.array([5, 5, 5, 6, 6, 6])


def counts(by, noise=0.3, n=3000):
    """Return (n, 6) counts of unloaded taxels plus `by` (n,) or (n, 6)."""
    return REST + np.random.default_rng(0).normal(0.0, noise, (n, 6)) + np.reshape(by, (n, -1))


def test_a_drift_is_followed_board_by_board():
    drift = np.zeros((3000, 6))
    drift[:, :3] = np.linspace(0.0, 2.0, 3000)[:, None]
    by = baseline_rise_count(counts(drift), REST, BOARD)
    np.testing.assert_allclose(by[-1, :3], 2.0, atol=0.3)
    assert by[-1, 3:].max() < 0.2
    assert (np.diff(by, axis=0) >= 0.0).all()


def test_a_load_and_a_single_taxel_are_not_taken_for_drift():
    load = np.zeros((3000, 6))
    load[1000:2000] = -20.0
    load[:, 0] += 6.0
    assert baseline_rise_count(counts(load), REST, BOARD).max() < 0.5


def test_later_readings_do_not_change_the_drift():
    read = counts(np.linspace(0.0, 3.0, 3000))
    np.testing.assert_array_equal(
        baseline_rise_count(read[:1500], REST, BOARD), baseline_rise_count(read, REST, BOARD)[:1500]
    )
