"""The follow-up's model agrees with its authors' code: rows, regressors, and past counts."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.calibration import follow_up


def test_rows_before_a_jump_of_the_pressure_are_dropped():
    pressure_pa = 1e5 * np.array([0.10, 0.11, 0.12, 0.50, 0.12, 0.12, 0.13, 0.30])
    # 0.12 → 0.50 → 0.12: the rows before both jumps go; 0.30 goes, for the row before it is kept as the last one.
    assert follow_up.select_rows(pressure_pa).tolist() == [0, 1, 4, 5, 6]


def test_smoothing_begins_with_the_first_row():
    assert follow_up.smooth_causally(np.array([10.0, 20.0, 20.0]), 0.1) == pytest.approx([10.0, 11.0, 11.9])


def test_an_estimate_equals_the_model_equation():
    draw = np.random.default_rng(0)
    counts = 240.0 - 40.0 * draw.random((60, 2))
    coefficients = draw.normal(size=(2, 164)) / 200.0 ** np.array([3, 2, 1, 0, *[1, 2, 3, 4] * 40])
    expected = np.zeros((60, 2))
    for taxel in range(2):
        for n in range(60):
            c = counts[n, taxel]
            a3, a2, a1, a0 = coefficients[taxel, :4]
            expected[n, taxel] = a3 * c**3 + a2 * c**2 + a1 * c + a0
            for h in range(1, 41):
                past = counts[max(n - h, 0), taxel]
                for k in range(1, 5):
                    expected[n, taxel] += coefficients[taxel, 4 + 4 * (h - 1) + k - 1] * past**k
    np.testing.assert_allclose(follow_up.estimate_pressure(counts, coefficients), expected, rtol=1e-9)


def test_training_recovers_a_load_that_its_counts_determine():
    t = np.arange(32 * 1200) * 0.02
    load_pa = 1.5e5 * (1 - np.cos(2 * np.pi * t / 300)) + 2e4 * np.sin(t / 3) ** 2
    counts = (240.0 - 1.3e-4 * load_pa - 1e-10 * load_pa**2)[:, None]
    coefficients = follow_up.train(counts, load_pa)
    rows = counts[follow_up.EVERY - 1 :: follow_up.EVERY]
    left = follow_up.estimate_pressure(rows, coefficients)[:, 0] - load_pa[follow_up.EVERY - 1 :: follow_up.EVERY]
    assert coefficients.shape == (1, 164)
    assert np.sqrt((left**2).mean()) < 500.0
