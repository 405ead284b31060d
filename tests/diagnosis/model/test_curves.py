"""Curves with a smooth deviation, fitted and converted to polynomials."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.diagnosis.model.curves import curve_splines, fit_curves


def test_the_deviation_of_a_curve_is_fitted_and_exported_as_a_polynomial():
    rng = np.random.default_rng(1)
    activation = rng.uniform(-5.0, 90.0, (4000, 1, 12))
    usable = np.ones((1, 12), bool)
    curve = np.array([0.0, 2000.0, 12.0, 0.1])
    off = 6.0 - 0.1 * activation + 0.0008 * activation**2
    splines = curve_splines(activation, usable)
    read = off + rng.normal(0.0, 1.0, off.shape)
    known = np.ones((4000, 1), bool)
    changed = fit_curves(splines, read, activation, known, np.full(1, 5.0), np.ones((1, 12))).changed(curve, 0, 3)
    at = np.linspace(5.0, 85.0, 40)
    wanted = np.polynomial.polynomial.polyval(at + 6.0 - 0.1 * at + 0.0008 * at**2, curve)
    assert len(changed) == 7
    assert np.polynomial.polynomial.polyval(at, changed) == pytest.approx(wanted, rel=0.03, abs=1500.0)
