"""Convert counts to pressure by the calibration's polynomial, without memory.

    P_i = Σ_k c_k · a_i^k,   a_i = baseline_i − count_i   (activation)

Source: Sorrentino et al. 2020, eq. of the taxel's cubic; the format is insole-calibration/1. With the covariance C of a
taxel's coefficients, var P_i = Σ_jk C_jk · a^(j+k).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .calibration import Calibration


class StaticCurve:
    """The static curve of every taxel of one foot.

    Below `activation_threshold_count` the pressure is 0 (a threshold of 0 disables this). A strapped shoe presses
    without a person standing; the paper masked it with 30 counts.
    """

    def __init__(self, calibration: Calibration, activation_threshold_count: float) -> None:
        self.usable = calibration.usable
        self._baseline_count = calibration.baseline_count
        self.threshold_count = activation_threshold_count
        # (k, n_triangles, 12)
        self.coefficients = np.ascontiguousarray(np.moveaxis(calibration.coefficients_pa, -1, 0))
        self._variance: NDArray[np.float64] | None = None
        if calibration.covariance_pa2 is not None:
            degree = calibration.covariance_pa2.shape[-1]
            self._variance = np.zeros((2 * degree - 1, *self.usable.shape))
            for j in range(degree):
                for k in range(degree):
                    self._variance[j + k] += calibration.covariance_pa2[..., j, k]

    def pressure_pa(self, counts: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Return (…, n_triangles, 12) Pa from counts of that shape; NaN where the calibration lists no taxel."""
        activation = self._baseline_count - counts
        pressure = horner(self.coefficients, activation)
        if self.threshold_count > 0:
            pressure[activation < self.threshold_count] = 0.0
        return pressure

    @property
    def has_variance(self) -> bool:
        """Whether the calibration carries an uncertainty."""
        return self._variance is not None

    def variance_pa2(self, counts: NDArray[np.uint8]) -> NDArray[np.float64] | None:
        """Return (…, n_triangles, 12) variance in Pa², or None if the calibration has no covariance."""
        if self._variance is None:
            return None
        return horner(self._variance, self._baseline_count - counts)


def horner(coefficients: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Σ_k coefficients[k] · x^k for coefficients (k, …) and x (…)."""
    value: NDArray[np.float64] = coefficients[-1] * np.ones_like(x) if len(coefficients) == 1 else coefficients[-1] * x
    for coefficient in coefficients[-2:0:-1]:
        value += coefficient
        value *= x
    if len(coefficients) > 1:
        value += coefficients[0]
    return value
