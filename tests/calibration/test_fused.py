"""Cross-validation of degree and penalty, independent of units."""

from __future__ import annotations

import numpy as np
import pytest

from insole_daemon.calibration.fused import GAIN_SPREAD, _choose, common_curve, fit_fused
from insole_daemon.calibration.problem import FOLDS, FusedProblem, Weights
from insole_daemon.calibration.statistics import ChamberSums

M, N, SCALE = 30, 2000, 20.0
EXPONENTS = (1, 2, 3)


def chamber(unit: float = 1.0, noise: float = 500.0) -> tuple[FusedProblem, np.ndarray]:
    """Return a chamber problem whose taxels share a stiffening curve with different gains; pressures in `unit` Pa."""
    draw = np.random.default_rng(5)
    gain = draw.lognormal(0, 0.2, M)
    x = draw.uniform(0, 1.5, (N, 1)) / gain
    curve = np.array([1.0, 0.3, 0.1]) * 1.5e5
    pressure = curve[0] * (x * gain) + curve[1] * (x * gain) ** 2 + curve[2] * (x * gain) ** 3
    shown = (pressure[:, 0] + draw.normal(0, noise, N)) / unit
    parts = [slice(i * N // FOLDS, (i + 1) * N // FOLDS) for i in range(FOLDS)]
    valid = np.ones((N, M), bool)
    sums = tuple(ChamberSums.of(x[p], valid[p], shown[p], EXPONENTS) for p in parts)
    return FusedProblem(EXPONENTS, SCALE, np.ones((3, M)), (), sums), gain


def test_the_unit_of_pressure_does_not_change_the_fit() -> None:
    alike = Weights(np.ones(3), np.ones(M))
    in_pa, in_kpa = (fit_fused(chamber(unit)[0], alike, 1.5 * SCALE) for unit in (1.0, 1e3))
    assert in_pa.penalty == in_kpa.penalty
    assert np.allclose(in_pa.coefficients_pa, in_kpa.coefficients_pa * 1e3, rtol=1e-5)


def test_common_curve_recovers_curve_and_gains() -> None:
    problem, gain = chamber()
    curve, gains = common_curve(problem, Weights(np.zeros(3), np.full(M, 1 / 500.0**2)))
    assert GAIN_SPREAD > 0
    assert np.corrcoef(gains, gain)[0, 1] > 0.98
    assert gains.mean() == pytest.approx(1.0)
    assert curve[0] > 0


def test_the_strongest_equally_good_penalty_is_chosen() -> None:
    noisy = np.array([1.0, 1.2, 0.9, 1.1, 0.8])
    errors = {
        (1, 1.0): noisy * 2, (2, 1.0): noisy * 1.9,
        (1, 0.1): noisy + 0.01 * np.array([1, -1, 1, -1, 1]), (2, 0.1): noisy + 0.02,
        (1, 0.01): noisy + 0.001, (2, 0.01): noisy,
    }  # fmt: skip
    assert _choose(errors) == (1, 0.1)
