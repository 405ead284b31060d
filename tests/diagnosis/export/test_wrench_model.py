"""Corrected curves of an exported model can be inverted."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyval

from insole_daemon.diagnosis.export.wrench_model import _rising
from insole_daemon.errors import EffectError
from insole_daemon.physics.curve_inverse import CurveInverse

REACHED_COUNT = 120.0
COUNT = np.linspace(0.0, REACHED_COUNT, 200)


def curve(waves_pa: float) -> np.ndarray:
    """Coefficients of a corrected curve of degree 6, with waves by the error of its fit."""
    return Polynomial.fit(COUNT, 3e3 * COUNT + 20.0 * COUNT**2 - waves_pa * np.sin(COUNT / 15.0), 6).convert().coef


def test_a_curve_that_falls_is_replaced_by_the_nearest_that_rises():
    fitted = curve(100e3)
    with pytest.raises(EffectError, match="does not rise"):
        CurveInverse(fitted[None])
    rising = _rising(fitted, REACHED_COUNT)
    assert (np.diff(polyval(COUNT, rising)) > 0.0).all()
    inverse = CurveInverse(rising[None])
    np.testing.assert_allclose(inverse(polyval(COUNT, rising)[:, None])[:, 0], COUNT, atol=1e-6)
    assert np.std(polyval(COUNT, rising) - polyval(COUNT, fitted)) < 0.05 * np.ptp(polyval(COUNT, fitted))


def test_a_curve_that_rises_is_kept():
    fitted = curve(10e3)
    assert _rising(fitted, REACHED_COUNT) is fitted
