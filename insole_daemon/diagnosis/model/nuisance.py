"""Nuisance columns: errors of the calibration and of the reference, in every model, with their priors.

The error of a calibration is each triangle's own; that of the reference is shared by all triangles.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ..load_estimate import LoadEstimate
from ..observations.chamber import ChamberObservation
from ..observations.paired import PairedObservation
from ..operators import AT_ONCE
from .curves import N_SPLINES, curve_splines

GAIN_STD = 0.003  # of a triangle's calibration
BASELINE_STD_COUNT = 0.05  # of a triangle's
ROUNDED_STD_COUNT = 0.3  # of a simulation without noise, whose rounding errors are correlated
AT_ONCE_STD = 1.0  # part of the places in bursts: 0 if readings are taken as they are sent, 1 if all at once
REZERO_STD_COUNT = 2.0  # of the shift of a re-zero, which a few readings determine
CURVE_STD_COUNT = 0.04  # misfit of a calibration's polynomials
UNEVEN_KNOTS_S, UNSTEADY_KNOTS_S = 8.0, 2.0  # spacing of knots of a person's load and pace against a simulation's
LATE, UNEVEN = "late", "uneven"  # columns of a simulated load's error
ZERO_STD_PA = 100.0  # of the reference
OWN_OFFSET_STD_S, OWN_RATE_STD = 1e-5, 2e-4  # the offset is searched for, the rate is that of edges


@dataclass(frozen=True, slots=True)
class Priors:
    """Standard deviations of deviations that are not of the sensor, or were present when it was calibrated.

    `timing_s` and `share`: deviation of a simulated load from the person's, in time and relative. `curve_count`: of the
    static curves; those of a calibration that contains a memory have its mean curve. `has_wide_bounds`: the material
    may be an unusual one (`Term.wide_sum_bound`).
    """

    timing_s: float = 0.0
    share: float = 0.0
    curve_count: float = CURVE_STD_COUNT
    has_wide_bounds: bool = False

    @property
    def has_loose_curves(self) -> bool:
        """Return whether the curves are so free that no recalibration can be identified."""
        return self.curve_count > CURVE_STD_COUNT


USUAL = Priors()


@dataclass(frozen=True, eq=False)
class Nuisance:
    """Nuisance columns with their priors, in T blocks of N weighted rows."""

    own_names: tuple[str, ...]
    own: Array  # (T, b, N) of each triangle
    own_std: Array  # (b,)
    shared_names: tuple[str, ...]
    shared_std: Array  # (s,)
    # Each of the s shared columns is a course over time (s, N) times a factor of its kind (s,), of factors (f, T, N):
    # the pressure, the time, and beside a simulation the places in the bursts of both recordings.
    courses: Array
    kind: NDArray[np.intp]
    factors: Array

    def shared_of(self, t: int) -> Array:
        """Return the shared columns (s, N) at triangle `t`."""
        return np.asarray(self.factors[self.kind, t] * self.courses)

    def shared_sum(self, shares: Array) -> Array:
        """Return the sum (T, N) of the shared columns with coefficients `shares` (s,)."""
        sums = [shares[of_kind] @ courses for of_kind, courses in zip(*self._by_kind, strict=True)]
        return np.asarray(np.einsum("fn,ftn->tn", sums, self.factors))

    def of(self, at: NDArray[np.bool_]) -> Nuisance:
        """Return the columns at the triangles `at` (T,)."""
        return replace(self, own=self.own[at], factors=self.factors[:, at])

    def deviance(self, y: Array) -> float:
        """Return −2 ln of the likelihood of `y` (T, N) with these columns alone, plus a constant."""
        left = self.residual_of(y)
        with_shared = self.summed_with_shared(left)
        return float(np.sum(y * left) - with_shared @ self.shared_inverse @ with_shared) + self.log_determinant

    def load_error(self, shared: Array, own: Array) -> Array:
        """Return the rows (T, N) by which a simulated load differs from the person's.

        `shared` (s,) and `own` (T, b): coefficients of all shared and own columns.
        """
        of_shared = np.array([name == LATE for name in self.shared_names])
        of_own = np.array([name == UNEVEN for name in self.own_names])
        return np.asarray(self.shared_sum(shared * of_shared) + np.matmul((own * of_own)[:, None], self.own)[:, 0])

    def with_shared(self, rows: Array, t: int) -> Array:
        """Return inner products (k, s) of `rows` (k, N) at triangle `t` with the shared columns."""
        if len(rows) > len(self.kind):
            return np.asarray(rows @ self.shared_of(t).T)
        products = np.empty((len(rows), len(self.kind)))
        for of_kind, courses, factor in zip(*self._by_kind, self.factors[:, t], strict=True):
            products[:, of_kind] = (rows * factor) @ courses.T
        return products

    @cached_property
    def _by_kind(self) -> tuple[list[NDArray[np.bool_]], list[Array]]:
        """Return for each kind which shared columns (s,) are of it, and their courses."""
        of_kinds = [self.kind == k for k in range(len(self.factors))]
        return of_kinds, [self.courses[of_kind] for of_kind in of_kinds]

    def summed_with_shared(self, y: Array) -> Array:
        """Return inner products (s,) of the shared columns with `y` (T, N), summed over the triangles."""
        return np.asarray(np.sum(np.einsum("ftn,tn->fn", self.factors, y)[self.kind] * self.courses, axis=1))

    @cached_property
    def inverse(self) -> Array:
        """Return the inverse (T, b, b) of the own columns' Gram matrix with their priors."""
        return np.linalg.inv(np.matmul(self.own, self.own.transpose(0, 2, 1)) + np.diag(self.own_std**-2.0))

    @cached_property
    def own_of_shared(self) -> Array:
        """Return the coefficients (T, b, s) of the regression of shared columns on own ones."""
        with_own = np.stack([own @ self.shared_of(t).T for t, own in enumerate(self.own)])
        return np.asarray(np.matmul(self.inverse, with_own))

    @cached_property
    def shared_inverse(self) -> Array:
        """Return the inverse (s, s) of the shared columns' Gram matrix with priors, own columns projected out."""
        gram = np.diag(self.shared_std**-2.0)
        for t, (own, shares) in enumerate(zip(self.own, self.own_of_shared, strict=True)):
            shared = self.shared_of(t)
            gram += shared @ (shared - shares.T @ own).T
        return np.asarray(np.linalg.inv(gram))

    @cached_property
    def log_determinant(self) -> float:
        """Return the log determinant of the rows' covariance with these columns, less that of the noise alone."""
        own = -np.linalg.slogdet(self.inverse)[1].sum() + 2.0 * len(self.own) * np.log(self.own_std).sum()
        shared = -np.linalg.slogdet(self.shared_inverse)[1] + 2.0 * np.log(self.shared_std).sum()
        return float(own + shared)

    def residual_of(self, y: Array) -> Array:
        """Return the residual (T, N) of `y` (T, N) after regression on the own columns."""
        shares = np.matmul(self.inverse, np.matmul(self.own, y[..., None]))
        return np.asarray(y - np.matmul(shares.transpose(0, 2, 1), self.own)[:, 0])


def nuisance_of(load: LoadEstimate, weights: Array, priors: Priors) -> Nuisance:
    """Return the nuisance columns of one recording under `load`.

    `weights` (N, T): one over the standard deviation of a row; 0 if unknown.
    """
    seen = load.observation
    assert isinstance(seen, ChamberObservation)
    own_columns = [(name, (column * weights).T, std) for name, column, std in _of_calibration(load, priors)]
    delay_factor = -seen.reference.slope(seen.reference_s) * weights  # change of the residual per second of delay
    shared = list(_of_reference(seen, priors))
    return Nuisance(
        tuple(name for name, *_ in own_columns), np.stack([column for _, column, _ in own_columns], axis=1),
        np.array([std for *_, std in own_columns]),
        tuple(name for name, *_ in shared), np.array([std for *_, std in shared]),
        np.stack([course for _, _, course, _ in shared]), np.array([kind for _, kind, *_ in shared], np.intp),
        np.stack([weights.T, delay_factor.T, *_in_bursts(seen, delay_factor)]),
    )  # fmt: skip


def _of_calibration(load: LoadEstimate, priors: Priors) -> Iterator[tuple[str, Array, float]]:
    """Yield names, columns (N, T) and their prior standard deviations."""
    seen = load.observation
    assert isinstance(seen, ChamberObservation)
    # Loose curves and a gain of the known load together could cancel all readings, so both are of the readings alone.
    is_loose = priors.has_loose_curves
    slope_pa = seen.slope_pa if is_loose else load.slope_pa
    slope = load.wrench_of(slope_pa)[..., 0]
    gain = load.wrench_of(-slope_pa * (load.activation_count if is_loose else load.gained_count))[..., 0]
    yield "gain", gain, GAIN_STD
    yield "baseline", slope, ROUNDED_STD_COUNT if isinstance(seen, PairedObservation) else BASELINE_STD_COUNT
    splines = curve_splines(load.activation_count, seen.usable)
    columns = np.empty((N_SPLINES, *slope.shape))
    for first in range(0, len(slope), AT_ONCE):
        rows = slice(first, first + AT_ONCE)
        for column, spline in zip(columns, splines.at(load.activation_count[rows]), strict=True):
            column[rows] = load.wrench_of(slope_pa[rows] * spline)[..., 0]
    for column in columns:
        yield "curve", column, priors.curve_count
    if seen.rezeroed is not None:
        yield "rezero", slope * seen.rezeroed, REZERO_STD_COUNT
    if priors.share:
        yield UNEVEN, gain, priors.share
        for hat in _centred_hats(seen, UNEVEN_KNOTS_S):
            yield UNEVEN, gain * hat[:, None], priors.share


def _in_bursts(seen: ChamberObservation, delay_factor: Array) -> Iterator[Array]:
    """Yield the change (T, N) of rows if all readings of a burst were taken at once, by each of both recordings."""
    if isinstance(seen, PairedObservation):
        for place_s in seen.in_bursts_s:
            yield (delay_factor * (place_s - place_s.mean())).T


def _of_reference(seen: ChamberObservation, priors: Priors) -> Iterator[tuple[str, int, Array, float]]:
    """Yield name, kind, course (N,) and prior standard deviation of the shared columns.

    The kind is 0 for a pressure, 1 for a time, 2 and 3 for a part of the places in bursts.
    """
    yield "zero", 0, np.ones(len(seen.t_s)), ZERO_STD_PA
    if seen.offset_is_free:
        yield "offset_s", 1, np.ones(len(seen.t_s)), OWN_OFFSET_STD_S
        yield "rate", 1, seen.t_s - seen.t_s.mean(), OWN_RATE_STD
    if isinstance(seen, PairedObservation):
        for kind in (2, 3):
            yield "burst", kind, np.ones(len(seen.t_s)), AT_ONCE_STD
    if priors.timing_s:
        for hat in _centred_hats(seen, UNSTEADY_KNOTS_S):
            yield LATE, 1, hat, priors.timing_s


def _centred_hats(seen: ChamberObservation, over_s: float) -> Iterator[Array]:
    """Yield hat functions (N,) over time with knots `over_s` apart, each with mean 0."""
    knots_s = np.linspace(seen.t_s[0], seen.t_s[-1], max(round(float(np.ptp(seen.t_s)) / over_s), 1) + 1)
    for unit in np.eye(len(knots_s)):
        values = np.interp(seen.t_s, knots_s, unit)
        yield values - values.mean()
