"""The polynomial of every taxel, its threshold and its uncertainty."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from insole_daemon.config import Config
from insole_daemon.physics.calibration import Calibration, default
from insole_daemon.physics.static_curve import StaticCurve
from insole_daemon.skin.geometry import PRESSURE_TAXELS
from insole_daemon.skin.layout import builtin

N = 3
USABLE = np.tile(PRESSURE_TAXELS, (N, 1))


def calibration(coefficients: Any, baseline: Any = 240.0, covariance: NDArray[np.float64] | None = None) -> Calibration:
    """Return a calibration of N triangles; arguments are broadcast to all pressure taxels."""
    values = np.asarray(coefficients, float)
    values = np.broadcast_to(values, (N, 12, values.shape[-1]))
    if covariance is not None:
        covariance = np.where(USABLE[..., None, None], covariance, np.nan)
    return Calibration(
        foot="left",
        baseline_count=np.where(USABLE, np.asarray(baseline, float), np.nan),
        coefficients_pa=np.where(USABLE[..., None], values, np.nan),
        covariance_pa2=covariance,
        usable=USABLE,
        provenance={},
    )


def random_counts(seed: int, *shape: int) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (*shape, N, 12)).astype(np.uint8)


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 6), st.integers(0, 2**32))
def test_pressure_is_the_polynomial_of_the_activation(k: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    coefficients = rng.normal(0, 1, (N, 12, k)) * 8000.0 / 30.0 ** np.arange(k)
    baseline = rng.uniform(200, 260, (N, 12))
    counts = random_counts(seed, 4)
    pressure = StaticCurve(calibration(coefficients, baseline), 0).pressure_pa(counts)
    assert pressure.shape == (4, N, 12)
    for row, taxel in np.argwhere(USABLE):
        expected = polynomial.polyval(baseline[row, taxel] - counts[:, row, taxel], coefficients[row, taxel])
        np.testing.assert_allclose(pressure[:, row, taxel], expected, rtol=1e-9, atol=1e-6)
    assert np.isnan(pressure[:, ~USABLE]).all()


def test_a_lower_count_is_more_pressure_and_a_higher_one_is_negative() -> None:
    curve = StaticCurve(calibration([0.0, 8000.0]), 0)
    counts = np.full((N, 12), 240, np.uint8)
    counts[0, :3] = 230, 250, 0
    pressure = curve.pressure_pa(counts)
    assert pressure[0, :4].tolist() == [80_000.0, -80_000.0, 1_920_000.0, 0.0]


def test_the_papers_cubic_gives_its_pressures() -> None:
    pressure = StaticCurve(calibration([-100.0, 7900.0, 12.0, 0.11], 240.5), 0).pressure_pa(
        np.full((N, 12), 200, np.uint8)
    )
    activation = 40.5
    expected = -100 + 7900 * activation + 12 * activation**2 + 0.11 * activation**3
    assert pressure[USABLE] == pytest.approx(expected, rel=1e-12)


def test_a_curve_may_be_constant() -> None:
    pressure = StaticCurve(calibration([5.0]), 0).pressure_pa(random_counts(0))
    assert (pressure[USABLE] == 5.0).all()
    assert np.isnan(pressure[~USABLE]).all()


def test_below_the_threshold_there_is_no_pressure() -> None:
    counts = np.full((N, 12), 240, np.uint8)
    counts[0, :5] = 250, 211, 210, 209, 200
    pressure = StaticCurve(calibration([500.0, 8000.0]), 30).pressure_pa(counts)
    assert pressure[0, :5].tolist() == [0.0, 0.0, 240_500.0, 248_500.0, 320_500.0]
    assert (pressure[1, PRESSURE_TAXELS] == 0).all()
    assert np.isnan(pressure[~USABLE]).all(), "a thermal pad is not a taxel without load"


def test_a_threshold_of_0_is_off() -> None:
    counts = np.full((N, 12), 250, np.uint8)
    assert (StaticCurve(calibration([500.0, 8000.0]), 0).pressure_pa(counts)[USABLE] == 500 - 80_000).all()


def test_usable_taxels_are_those_of_the_calibration() -> None:
    assert StaticCurve(calibration([1.0]), 0).usable is USABLE


def test_the_built_in_calibration_is_8_kpa_per_count() -> None:
    layout, boards = builtin("left", (5, 6, 7)), Config().insoles[0].boards
    counts = np.full((28, 12), 200, np.uint8)
    made = default(layout, boards)
    pressure = StaticCurve(made, 0).pressure_pa(counts)
    rest = made.baseline_count[0, 0]
    assert 240 <= rest < 241
    assert pressure[:, PRESSURE_TAXELS] == pytest.approx((rest - 200) * 8000)
    assert StaticCurve(made, 0).variance_pa2(counts) is None


# ---- uncertainty


def random_covariance(rng: np.random.Generator, *shape: int, k: int) -> NDArray[np.float64]:
    """Return covariances of the k coefficients with the magnitudes of a fit."""
    root = rng.normal(0, 1, (*shape, k, k)) * (300.0 / 30.0 ** np.arange(k))[:, None]
    return root @ root.swapaxes(-1, -2)


@pytest.mark.parametrize("k", [1, 2, 4])
def test_variance_is_the_quadratic_form_of_the_powers(k: int) -> None:
    rng = np.random.default_rng(k)
    covariance = random_covariance(rng, N, 12, k=k)
    curve = StaticCurve(calibration(np.ones(k), 240.25, covariance), 0)
    counts = random_counts(k, 3)
    variance = curve.variance_pa2(counts)
    assert variance is not None
    assert variance.shape == (3, N, 12)
    for cycle, row, taxel in np.argwhere(np.broadcast_to(USABLE, (3, N, 12))):
        powers = (240.25 - counts[cycle, row, taxel]) ** np.arange(k)
        expected = powers @ covariance[row, taxel] @ powers
        assert variance[cycle, row, taxel] == pytest.approx(expected, rel=1e-9)
    assert np.isnan(variance[:, ~USABLE]).all()


def test_variance_is_that_of_drawn_coefficients() -> None:
    rng = np.random.default_rng(7)
    mean, covariance = np.array([0.0, 7900.0, 12.0, 0.11]), random_covariance(rng, k=4)
    drawn = rng.multivariate_normal(mean, covariance, 20_000)
    for count in (230, 180, 60):
        counts = np.full((N, 12), count, np.uint8)
        variance = StaticCurve(calibration(mean, 240.0, covariance), 0).variance_pa2(counts)
        assert variance is not None
        pressures = polynomial.polyval(240.0 - count, drawn.T)
        assert variance[0, 0] == pytest.approx(pressures.var(), rel=0.05)


def test_variance_is_none_without_a_covariance() -> None:
    assert StaticCurve(calibration([0.0, 8000.0]), 0).variance_pa2(random_counts(1)) is None
