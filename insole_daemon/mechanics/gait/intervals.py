"""Means of steps with intervals that hold although steps in a row resemble each other.

Stride times and forces are correlated from step to step (Hausdorff et al. 1995, J. Appl. Physiol. 78:349), so that
SD / √n is too small. The variance of the mean is estimated from the ν lowest frequencies of the series instead
(equal-weighted cosines; Lazarus, Lewis, Stock & Watson 2018, J. Bus. Econ. Stat. 36:541):

    Λ_j = √(2/n) · Σ_i r_i · cos(π j (i − 1/2) / n),   Ω = (1/ν) Σ_j Λ_j² / s_j,   var(mean) = Ω / n,
    s_j = (1 − ρ)² / (1 − 2ρ cos(π j / n) + ρ²),   ν = 0.4 · n^(2/3)

and the interval uses Student's t with ν degrees of freedom. Of few steps even the lowest frequencies are not low, and a
correlated series has less power there than at frequency 0: s_j is that ratio for a first-order series that is
correlated by ρ = 0.4, and tends to 1 for many steps. The stated 95 % hold within 2 % from 8 steps on for correlations
from 0 to 0.5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...errors import InsoleError
from ...extras import install_command

FEWEST = 3  # values that an interval is made of
LEAST_DOF = 2
SUPPOSED_CORRELATION = 0.4  # from step to step
LEVEL = 0.95
NORMAL_QUANTILE = 1.959964  # of LEVEL, two-sided

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate and its 95 % interval; NaN: not known."""

    value: float
    low: float
    high: float
    n: int  # values, or pairs, it is made of

    def __str__(self) -> str:
        """Value and interval to four digits."""
        return f"{self.value:.4g} [{self.low:.4g}, {self.high:.4g}] (n = {self.n})"

    def __contains__(self, value: float) -> bool:
        """Return whether `value` lies in the interval."""
        return self.low <= value <= self.high


def mean_variance(residuals: Array) -> tuple[float, float]:
    """Return the variance of the mean of a series in order of time, and its degrees of freedom.

    `residuals` (n,): the series about its mean, n ≥ `FEWEST`.
    """
    n = len(residuals)
    dof = max(round(0.4 * n ** (2 / 3)), LEAST_DOF)
    frequency = np.pi * np.arange(1, dof + 1) / n
    weights = np.sqrt(2 / n) * (np.cos(frequency[:, None] * (np.arange(n) + 0.5)) @ residuals)
    rho = SUPPOSED_CORRELATION
    power_ratio = (1 - rho) ** 2 / (1 - 2 * rho * np.cos(frequency) + rho**2)
    return float(np.mean(weights**2 / power_ratio) / n), float(dof)


def t_quantile(dof: float) -> float:
    """Return the half width of the two-sided 95 % interval in standard errors."""
    try:
        from scipy.special import stdtrit
    except ImportError as error:
        raise InsoleError(
            f"intervals need the package scipy, which is not installed: {install_command('lab')}"
        ) from error
    return float(stdtrit(dof, 0.5 + LEVEL / 2))


def mean_interval(values: Array, systematic_std: float = 0.0) -> Interval:
    """Return the mean of `values` (n,) in order of time, NaN left out.

    `systematic_std` is the standard deviation of an error that all of them share.
    """
    known = values[np.isfinite(values)]
    if len(known) < FEWEST:
        mean = float(known.mean()) if len(known) else np.nan
        return Interval(mean, np.nan, np.nan, len(known))
    mean = float(known.mean())
    variance, dof = mean_variance(known - mean)
    half = np.hypot(t_quantile(dof) * np.sqrt(variance), NORMAL_QUANTILE * systematic_std)
    return Interval(mean, mean - float(half), mean + float(half), len(known))
