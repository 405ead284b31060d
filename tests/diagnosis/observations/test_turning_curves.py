"""Static curves that turn over: readings beyond are read on a straight line."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.diagnosis.observations.wrench import turning_count


@pytest.mark.parametrize(
    ("coefficients_pa", "from_count"),
    [
        ([0.0, 1000.0], np.inf),
        ([0.0, 1000.0, 10.0], np.inf),
        ([0.0, 1000.0, 0.0, -0.1], 53.0),  # 1000 − 0.3·a² is a quarter of 1000 − 0.1·a² at 52.2
        ([0.0, -100.0, 100.0, 0.0], np.inf),  # falls at first
    ],
)
def test_a_curve_turns_where_it_rises_by_a_quarter_of_its_mean(coefficients_pa, from_count):
    assert turning_count(np.array(coefficients_pa)) == from_count
