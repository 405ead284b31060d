"""The calibration that is handed out rises over its range."""

import numpy as np
import pytest

from benchmarks.diagnosis.blind.calibration_file import fit_rising


@pytest.mark.parametrize("dead_count", [0.0, 20.0])
def test_a_curve_rises_even_if_the_readings_it_is_fitted_to_come_late(dead_count):
    activation = np.linspace(0.0, 40.0, 400)
    coefficients = fit_rising(activation, 2e3 * np.maximum(activation - dead_count, 0.0), np.ones(400))
    slopes = np.polyval(np.polyder([*coefficients[::-1], 0.0]), activation[1:])
    assert slopes.min() > 0.0
    if not dead_count:
        assert coefficients == pytest.approx([2e3, 0.0, 0.0], abs=1e-3)
