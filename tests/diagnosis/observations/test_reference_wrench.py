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


@pytest.mark.parametrize("lag_s", [0.0, 0.003, 0.02])
@pytest.mark.parametrize("row_s", [0.005, 0.01, 1 / 120, 0.02])
def test_interpolation_and_a_lag_keep_the_stated_share_of_the_noise(row_s, lag_s):
    reference = noise(row_s)
    for later_s in np.linspace(0.0, row_s, 4, endpoint=False).tolist():
        t_s = 1.0 + later_s + np.arange(50) * row_s  # always at the same phase between two rows
        kept = reference.noise_kept(t_s, lag_s)
        assert np.mean(reference.at(t_s, lag_s) ** 2) == pytest.approx(kept.mean(), rel=0.06)
