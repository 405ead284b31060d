"""Curves with a smooth deviation, fitted and converted to polynomials."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial.polynomial import polyval

from insole_daemon.diagnosis.model.curves import curve_splines, fit_curves, heldout_rest

GIVEN = np.array([0.0, 2000.0, 12.0, 0.1])


def deviation(count: np.ndarray) -> np.ndarray:
    """Counts, up to a third of the activation."""
    return 6.0 + 0.1 * count + 0.002 * count**2


def test_a_large_deviation_of_a_curve_is_fitted_and_exported_as_a_polynomial():
    """A taxel that reads a − d(a) has the pressure of its present curve at a, also above the range of that curve."""
    rng = np.random.default_rng(1)
    count = rng.uniform(-5.0, 90.0, (4000, 1, 12))
    splines = curve_splines(count, np.ones((1, 12), bool))
    off = deviation(count) + rng.normal(0.0, 1.0, count.shape)
    curves = fit_curves(splines, off, count, np.ones((4000, 1), bool), np.full(1, 5.0), np.ones((1, 12)))
    at = np.linspace(10.0, 88.0, 40)
    corrected = curves.corrected(GIVEN, 200.0, 0, 3)
    assert polyval(at - deviation(at), corrected) == pytest.approx(polyval(at, GIVEN), rel=0.02, abs=1500.0)
    without_rows = fit_curves(splines, off, count, np.zeros((4000, 1), bool), np.full(1, 5.0), np.ones((1, 12)))
    assert without_rows.corrected(GIVEN, 200.0, 0, 3) is GIVEN
    straight = curves.corrected(GIVEN, 60.0, 0, 3)
    above = np.linspace(65.0, 88.0, 10)
    wanted = polyval(60.0, GIVEN) + (above - 60.0) * (2000.0 + 24.0 * 60.0 + 0.3 * 60.0**2)
    assert polyval(above - deviation(above), straight) == pytest.approx(wanted, rel=0.02)


def test_a_curve_whose_deviation_takes_all_of_its_range_is_kept():
    """As that of a taxel whose rows do not determine one: every reading would be the same pressure."""
    count = np.random.default_rng(1).uniform(-5.0, 90.0, (4000, 1, 12))
    splines = curve_splines(count, np.ones((1, 12), bool))
    curves = fit_curves(splines, 0.9 * count, count, np.ones((4000, 1), bool), np.full(1, 50.0), np.ones((1, 12)))
    assert curves.corrected(GIVEN, 200.0, 0, 3) is GIVEN


def test_a_curve_without_slope_at_zero_is_corrected():
    count = np.random.default_rng(1).uniform(-5.0, 90.0, (4000, 1, 12))
    splines = curve_splines(count, np.ones((1, 12), bool))
    curves = fit_curves(splines, deviation(count), count, np.ones((4000, 1), bool), np.full(1, 5.0), np.ones((1, 12)))
    flat, at = np.array([0.0, 0.0, 70.0]), np.linspace(30.0, 88.0, 40)
    corrected = curves.corrected(flat, 200.0, 0, 3)
    assert polyval(at - deviation(at), corrected) == pytest.approx(polyval(at, flat), rel=0.05)


def test_curves_are_not_extrapolated_to_held_out_readings():
    """Without load an insole may be read only before the first step: a loop leaves all later readings above."""
    count = np.concatenate([np.linspace(0.0, 5.0, 400), np.linspace(27.0, 90.0, 1600)])
    left_by_law = np.where(count < 6.0, 0.0, 3.0 * np.cos(count / 4.0))
    at, off = (np.tile(each[:, None, None], (1, 1, 12)) for each in (count, left_by_law))
    fold = np.concatenate([np.zeros(400, int), 1 + np.arange(1600) % 4])
    usable, known, std = np.ones((1, 12), bool), np.ones((2000, 1), bool), np.full(1, 5.0)
    rest = heldout_rest(curve_splines(at, usable), off, at, known, std, np.ones((1, 12)), fold)
    assert np.abs(rest).max() < 6.0
