"""Symmetry indices: their value, and how often their interval holds."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.errors import InsoleError
from insole_daemon.mechanics.gait.intervals import mean_interval
from insole_daemon.mechanics.gait.symmetry import symmetry, symmetry_index
from insole_daemon.simulation.foot import Walk

from .walked import LAYOUTS, steps_of


def limping(random, n, limp_percent, correlation):
    """Values of n left and right steps whose SI is limp_percent; 3 % from step to step, correlated."""
    noise = random.standard_normal((2, n + 50))
    for at in range(1, n + 50):
        noise[:, at] = correlation * noise[:, at - 1] + np.sqrt(1 - correlation**2) * noise[:, at]
    varied = 1 + 0.03 * noise[:, 50:]
    return 600 * (1 + limp_percent / 200) * varied[0], 600 * (1 - limp_percent / 200) * varied[1]


@pytest.mark.parametrize("limp_percent", [0.0, 6.0])
@pytest.mark.parametrize(("n", "correlation"), [(8, 0.0), (8, 0.5), (12, 0.0), (50, 0.0), (50, 0.3)])
def test_95_percent_of_the_intervals_hold(limp_percent, n, correlation):
    random = np.random.default_rng(11)
    inside = [limp_percent in symmetry_index(*limping(random, n, limp_percent, correlation)) for _ in range(1000)]
    assert 0.93 <= np.mean(inside) <= 0.97


def test_the_index_is_that_of_robinson():
    assert symmetry_index(np.full(5, 103.0), np.full(5, 97.0)).value == pytest.approx(6.0)


def test_too_few_steps_have_no_interval():
    index = symmetry_index(np.array([103.0, 103.0]), np.array([97.0, 97.0]))
    assert index.value == pytest.approx(6.0)
    assert np.isnan(index.low)
    assert np.isnan(symmetry_index(np.array([np.nan]), np.array([1.0])).value)


def test_a_symmetric_walk_is_symmetric_and_an_uncertain_wrench_widens_the_interval():
    walk = Walk(list(LAYOUTS.values()), seed=4)
    sure, unsure = steps_of(walk, 30.0), steps_of(walk, 30.0, std_pa=20_000.0)
    assert 0.0 in symmetry(sure, "peak_force_n")
    one, other = symmetry(sure, "impulse_n_s"), symmetry(unsure, "impulse_n_s")
    assert other.high - other.low > one.high - one.low


def test_a_figure_that_is_none_is_refused():
    with pytest.raises(InsoleError, match="stance_s"):
        symmetry(steps_of(Walk(list(LAYOUTS.values())), 8.0), "foot")


def test_the_interval_of_a_mean_holds_for_correlated_steps():
    random = np.random.default_rng(5)
    inside = [0.0 in mean_interval(limping(random, 60, 0.0, 0.4)[0] - 600.0) for _ in range(1000)]
    assert 0.92 <= np.mean(inside) <= 0.97
