"""The calibration that is handed out rises over its range."""

import numpy as np
import pytest

from benchmarks.diagnosis.blind.calibration_file import fit_rising


@pytest.mark.parametrize("is_bent", [False, True])
def test_a_curve_rises_even_if_a_memory_bends_the_readings_it_are_fitted_to(is_bent):
    activation = np.linspace(0.0, 40.0, 400)
    pressure = 2e3 * activation - 8e4 * np.exp(-activation / 4.0) * is_bent * (activation / 10.0)
    coefficients = fit_rising(activation, pressure, np.ones(400))
    slopes = np.polyval(np.polyder([*coefficients[::-1], 0.0]), activation)
    assert slopes.min() > 0.0
    if not is_bent:
        assert coefficients == pytest.approx([2e3, 0.0, 0.0], abs=1e-3)
