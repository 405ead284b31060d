"""Symmetry indices of left and right, with 95 % intervals.

    SI = 200 · (mean left − mean right) / (mean left + mean right)   in percent

(Robinson et al. 1987, J. Manip. Physiol. Ther. 10:172): 0 symmetric, positive where the left is more.

Every left step is paired with the right step that follows it, so that what both share, as speed, cancels. With
θ = SI / 100, r_i = 2 (l_i − r_i) − θ (l_i + r_i) has mean 0, and var(θ) = var(mean r) / mean(l + r)². The variance of
the mean is that of intervals.py.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .events import LONGEST_STRIDE_S
from .intervals import FEWEST, NORMAL_QUANTILE, Interval, mean_variance, t_quantile
from .steps import Steps

Array = NDArray[np.float64]


def symmetry(steps: Steps, figure: str) -> Interval:
    """Return the SI in percent of `figure` of the steady steps.

    The uncertainty of both feet's wrenches widens the interval. InsoleError: `figure` is none.
    """
    steps.check_figure(figure)
    steady = steps.steady
    left, right = pair_steps(steady)
    values, std = steady[figure], steady.std(figure)
    relative = [float(np.mean(std[rows]) / np.mean(values[rows])) if len(rows) else np.nan for rows in (left, right)]
    systematic_std = 100.0 * math.hypot(*relative)
    return symmetry_index(values[left], values[right], systematic_std if np.isfinite(systematic_std) else 0.0)


def pair_steps(steps: Steps) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows of left steps, and of the right step that follows each of them within a stride."""
    is_left, contact_s = steps["foot"] == "left", steps["contact_s"]
    follows = is_left[:-1] & ~is_left[1:] & (np.diff(contact_s) <= LONGEST_STRIDE_S)
    left = np.flatnonzero(follows)
    return left, left + 1


def symmetry_index(left: Array, right: Array, systematic_std_percent: float = 0.0) -> Interval:
    """Return the SI in percent of the pairs `left` and `right` (n,) in order of time; pairs with NaN are left out."""
    known = np.isfinite(left) & np.isfinite(right)
    left, right = left[known], right[known]
    n = len(left)
    total = float(np.mean(left + right)) if n else np.nan
    if n < 1 or not total > 0:
        return Interval(np.nan, np.nan, np.nan, n)
    index = 2.0 * float(np.mean(left - right)) / total
    if n < FEWEST:
        return Interval(100.0 * index, np.nan, np.nan, n)
    variance, dof = mean_variance(2.0 * (left - right) - index * (left + right))
    half = np.hypot(100.0 * t_quantile(dof) * np.sqrt(variance) / total, NORMAL_QUANTILE * systematic_std_percent)
    return Interval(100.0 * index, 100.0 * index - float(half), 100.0 * index + float(half), n)
