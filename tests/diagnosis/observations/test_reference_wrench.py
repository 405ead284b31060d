"""The noise of a reference between its rows."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from insole_daemon.diagnosis.observations.reference_wrench import FINE_S, ReferenceWrench

DRAWS = 200


def noise(row_s: float) -> ReferenceWrench:
    """DRAWS channels of white noise of variance 1 in rows that are `row_s` apart."""
    rows = np.random.default_rng(1).standard_normal((round(6.0 / row_s), DRAWS))
    row_time_s = np.arange(len(rows)) * row_s
    grid_s = np.arange(0.0, row_time_s[-1], FINE_S)
    fine = CubicSpline(row_time_s, rows)(grid_s)
    return ReferenceWrench(0.0, fine, np.ones(len(grid_s), bool), np.ones(DRAWS), "own", True, row_s)


@pytest.mark.parametrize("lag_s", [0.0, 0.001, 0.003, 0.02])
@pytest.mark.parametrize("row_s", [0.005, 0.01, 1 / 120, 0.02])
def test_interpolation_and_a_lag_keep_the_stated_share_of_the_noise(row_s, lag_s):
    reference = noise(row_s).denoised
    for later_s in np.linspace(0.0, row_s, 4, endpoint=False).tolist():
        t_s = 1.0 + later_s + np.arange(round(4.0 / row_s)) * row_s  # always at the same phase between two rows
        kept = reference.noise_kept(t_s, lag_s)
        assert np.mean(reference.at(t_s, lag_s) ** 2) == pytest.approx(kept.mean(), rel=0.06)


@pytest.mark.parametrize("lag_s", [0.0, 0.002, 0.004, 0.02])
def test_neither_interpolation_nor_a_lag_blurs_a_course(lag_s):
    """A lag of 4 ms and a delay of 4 ms differ by less than lines between points of the fine grid blur."""
    omega = 2 * np.pi * 7.0
    fine = np.sin(omega * FINE_S * np.arange(600))[:, None]
    reference = ReferenceWrench(0.0, fine, np.ones(600, bool), np.ones(1), "own", True, FINE_S).denoised
    t_s = 1.0 + 0.7e-3 * np.arange(1000)
    expected = np.imag(np.exp(1j * omega * t_s) / (1.0 + 1j * omega * lag_s))
    assert np.abs(reference.at(t_s, lag_s)[:, 0] - expected).max() < 1e-3
