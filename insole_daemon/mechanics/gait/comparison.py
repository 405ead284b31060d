"""Sessions compared: differences of figures with 95 % intervals, and a permutation test over the stance curve.

Two sessions of one person: the difference of the means of steady steps, Welch's interval with the variances of
intervals.py. Several persons, each in two conditions: the mean of the persons' differences, Student's interval.

The curves are compared at every percent of stance by |t|. Labels (of steps, or signs of persons' differences) are
permuted, and each permutation gives the largest |t| of the whole curve: a percent is significant at a p that holds for
all 101 together (Nichols & Holmes 2002, Hum. Brain Mapp. 15:1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ...errors import InsoleError
from .figures import PERCENT
from .intervals import FEWEST, NORMAL_QUANTILE, Interval, mean_variance, t_quantile
from .steps import Steps, mean_curve

PERMUTATIONS = 4999
ALL_SIGNS_TO = 12  # persons: up to here all 2^n signs are tried
SIGNIFICANT_P = 0.05

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CurveTest:
    """The difference of two curves over stance, second less first."""

    difference: Array  # (101,)
    t: Array  # (101,) NaN where nothing is known
    p: Array  # (101,) of the largest |t| of the curve: corrected for all 101
    n_permutations: int

    def __repr__(self) -> str:
        """Describe the result in one line."""
        spans = ", ".join(f"{low:.0f} to {high:.0f} %" for low, high in self.spans_percent) or "nowhere"
        return f"CurveTest: differs {spans} of stance, p = {self.p_whole:.4f} of {self.n_permutations} permutations"

    @property
    def p_whole(self) -> float:
        """The p of the null hypothesis that the curves do not differ anywhere; NaN: not known."""
        return float(np.nanmin(self.p)) if np.isfinite(self.p).any() else np.nan

    @property
    def spans_percent(self) -> tuple[tuple[float, float], ...]:
        """First and last percent of every part of stance with p < 0.05."""
        significant = np.concatenate([[False], self.p < SIGNIFICANT_P, [False]])
        edges = np.flatnonzero(np.diff(significant.astype(np.int8))).reshape(-1, 2)
        return tuple((float(PERCENT[first]), float(PERCENT[end - 1])) for first, end in edges.tolist())


def difference_of_sessions(first: Steps, second: Steps, figure: str) -> Interval:
    """Return the mean of `figure` over the steady steps of `second` less that of `first`.

    With the same calibration its error is the same in both, and cancels; with two, or another sensor, both errors
    widen the interval.
    """
    means, variances, dofs, systematic = [], [], [], 0.0
    for steps in (first, second):
        steps.check_figure(figure)
        steady = steps.steady
        values = steady[figure][np.isfinite(steady[figure])]
        if len(values) < FEWEST:
            return Interval(np.nan, np.nan, np.nan, len(values))
        variance, dof = mean_variance(values - values.mean())
        means.append(float(values.mean()))
        variances.append(variance)
        dofs.append(dof)
        if first.calibrations != second.calibrations:
            systematic += float(np.nan_to_num(steady.std(figure)).mean()) ** 2
    total = sum(variances)
    dof = total**2 / sum(v**2 / d for v, d in zip(variances, dofs, strict=True)) if total > 0 else min(dofs)
    half = float(np.hypot(t_quantile(dof) * np.sqrt(total), NORMAL_QUANTILE * np.sqrt(systematic)))
    difference = means[1] - means[0]
    return Interval(difference, difference - half, difference + half, min(len(first.steady), len(second.steady)))


def paired_difference(pairs: Sequence[tuple[Steps, Steps]], figure: str) -> Interval:
    """Return the mean over persons of the difference, second session less first, of the mean of the steady steps."""
    differences = []
    for first, second in pairs:
        means = [_mean(steps, figure) for steps in (first, second)]
        differences.append(means[1] - means[0])
    known = np.array([difference for difference in differences if np.isfinite(difference)])
    if len(known) < FEWEST:
        return Interval(float(known.mean()) if len(known) else np.nan, np.nan, np.nan, len(known))
    half = t_quantile(len(known) - 1) * float(known.std(ddof=1)) / np.sqrt(len(known))
    return Interval(float(known.mean()), float(known.mean() - half), float(known.mean() + half), len(known))


def compare_curves(first: Steps, second: Steps, curve: str = "f_z_n", seed: int = 0) -> CurveTest:
    """Test the difference of two sessions' curves by permuting steps between them.

    `curve` is a name in `Steps.curves`, `seed` that of the permutations. InsoleError: fewer than `FEWEST` steady steps.
    """
    groups = [_curves(steps.steady, curve) for steps in (first, second)]
    n_first, n_second = map(len, groups)
    if min(n_first, n_second) < FEWEST:
        raise InsoleError(f"a permutation test needs {FEWEST} steady steps a session, found {n_first} and {n_second}")
    curves = np.concatenate(groups)
    known = np.asarray(np.isfinite(curves).all(axis=0))
    random = np.random.default_rng(seed)
    in_second = np.arange(len(curves)) >= n_first
    largest_t = np.empty(PERMUTATIONS)
    for number in range(PERMUTATIONS):
        largest_t[number] = np.abs(_welch_t(curves[:, known], random.permutation(in_second))).max(initial=0.0)
    difference = mean_curve(groups[1])[0] - mean_curve(groups[0])[0]
    return _result(difference, known, _welch_t(curves[:, known], in_second), largest_t)


def compare_paired_curves(pairs: Sequence[tuple[Steps, Steps]], curve: str = "f_z_n", seed: int = 0) -> CurveTest:
    """Test the mean of the persons' differences of curves by permuting the signs of the differences.

    InsoleError: fewer than `FEWEST` persons.
    """
    if len(pairs) < FEWEST:
        raise InsoleError(f"a paired permutation test needs {FEWEST} persons, found {len(pairs)}")
    means = [[mean_curve(_curves(steps.steady, curve))[0] for steps in pair] for pair in pairs]
    curves = np.array([second - first for first, second in means])
    known = np.asarray(np.isfinite(curves).all(axis=0))
    n = len(curves)
    if n <= ALL_SIGNS_TO:
        signs = np.array(list(product((1.0, -1.0), repeat=n)))
    else:
        signs = np.random.default_rng(seed).choice((-1.0, 1.0), (PERMUTATIONS, n))
    largest_t = np.array([np.abs(_one_sample_t(sign[:, None] * curves[:, known])).max(initial=0.0) for sign in signs])
    return _result(curves.mean(axis=0), known, _one_sample_t(curves[:, known]), largest_t)


def _result(difference: Array, known: NDArray[np.bool_], t: Array, largest_t: Array) -> CurveTest:
    """Return the test result.

    `largest_t` (n_permutations,) is the largest |t| of the curve in each permutation. The measured labels count as one
    more permutation.
    """
    whole_t, p = np.full(len(known), np.nan), np.full(len(known), np.nan)
    whole_t[known] = t
    n_as_large = np.count_nonzero(largest_t[:, None] >= np.abs(t) - 1e-9, axis=0)
    p[known] = (n_as_large + 1) / (len(largest_t) + 1)
    return CurveTest(difference, whole_t, np.minimum(p, 1.0), len(largest_t))


def _welch_t(curves: Array, in_second: NDArray[np.bool_]) -> Array:
    groups = curves[~in_second], curves[in_second]
    variance = sum(group.var(axis=0, ddof=1) / len(group) for group in groups)
    with np.errstate(over="ignore"):
        return np.asarray((groups[1].mean(axis=0) - groups[0].mean(axis=0)) / np.sqrt(variance + np.finfo(float).tiny))


def _one_sample_t(curves: Array) -> Array:
    error = curves.std(axis=0, ddof=1) / np.sqrt(len(curves))
    with np.errstate(over="ignore"):  # where all curves are the same
        return np.asarray(curves.mean(axis=0) / (error + np.finfo(float).tiny))


def _mean(steps: Steps, figure: str) -> float:
    steps.check_figure(figure)
    values = steps.steady[figure]
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else np.nan


def _curves(steps: Steps, curve: str) -> Array:
    if curve not in steps.curves:
        raise InsoleError(f"expected a curve over stance ({', '.join(steps.curves)}), found {curve!r}")
    return steps.curves[curve]
