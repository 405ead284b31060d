"""What a calibration and the reference may be off by: columns that are in every model, with their priors.

A calibration's error is each triangle's own; the reference's is common to all of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...physics.law import Array
from ..observations.chamber import ChamberObservation
from ..observations.paired import PairedObservation
from .curves import curve_splines
from .load import LoadEstimate

GAIN_STD = 0.003  # of a triangle's calibration
BASELINE_STD_COUNT = 0.05  # of a triangle's
ROUNDED_STD_COUNT = 0.3  # of a simulation without noise, whose counts round all one way
REZERO_STD_COUNT = 2.0  # of a shift that a few readings tell
CURVE_STD_COUNT = 0.04  # what the polynomials of a calibration miss
UNEVEN_S, UNSTEADY_S = 8.0, 2.0  # over which a person's load and pace wander from a simulation's
ZERO_STD_PA = 100.0  # of the reference
OWN_OFFSET_STD_S, OWN_RATE_STD = 1e-5, 2e-4  # the offset is searched for, the rate is that of edges


@dataclass(frozen=True, slots=True)
class Priors:
    """One standard deviation of what is not of the sensor, or was there when it was calibrated.

    A simulated load may differ from the person's in time, and by a share. Curves may be off by counts: those of a
    calibration that a memory was in contain its mean curve.
    """

    timing_s: float = 0.0
    share: float = 0.0
    curve_count: float = CURVE_STD_COUNT

    @property
    def has_loose_curves(self) -> bool:
        """Whether a recalibration could be anything, and none can be identified."""
        return self.curve_count > CURVE_STD_COUNT


USUAL = Priors()


@dataclass(frozen=True, eq=False)
class Nuisance:
    """Columns that are in every model, with their priors, in T blocks of N weighted rows."""

    own: Array  # (T, b, N) each triangle's
    own_std: Array  # (b,)
    shared_names: tuple[str, ...]
    shared_std: Array  # (s,)
    # Each of the reference's s columns is a course over time (s, N), times what it is at every triangle: the factor of
    # its kind (s,), of factors (f, T, N).
    courses: Array
    kind: NDArray[np.intp]
    factors: Array

    def shared_of(self, t: int) -> Array:
        """(s, N) the reference's columns at a triangle."""
        return np.asarray(self.factors[self.kind, t] * self.courses)

    def shared_sum(self, shares: Array) -> Array:
        """(T, N) of the reference's columns with `shares` (s,)."""
        sums = [shares[self.kind == k] @ self.courses[self.kind == k] for k in range(len(self.factors))]
        return np.asarray(np.einsum("fn,ftn->tn", sums, self.factors))

    def with_shared(self, rows: Array, t: int) -> Array:
        """(k, s) inner products of `rows` (k, N) at a triangle with the reference's columns."""
        found = np.empty((len(rows), len(self.kind)))
        for k, factor in enumerate(self.factors[:, t]):
            found[:, self.kind == k] = (rows * factor) @ self.courses[self.kind == k].T
        return found

    def summed_with_shared(self, y: Array) -> Array:
        """(s,) inner products of the reference's columns with `y` (T, N), of all triangles together."""
        return np.asarray(np.sum(np.einsum("ftn,tn->fn", self.factors, y)[self.kind] * self.courses, axis=1))

    @cached_property
    def inverse(self) -> Array:
        """(T, b, b) of the own columns' inner products with their priors."""
        return np.linalg.inv(np.matmul(self.own, self.own.transpose(0, 2, 1)) + np.diag(self.own_std**-2.0))

    @cached_property
    def own_of_shared(self) -> Array:
        """(T, b, s) shares of the own columns in the reference's."""
        with_own = np.stack([own @ self.shared_of(t).T for t, own in enumerate(self.own)])
        return np.asarray(np.matmul(self.inverse, with_own))

    @cached_property
    def shared_inverse(self) -> Array:
        """(s, s) of the reference's columns' inner products with their priors, own columns projected out."""
        left = np.diag(self.shared_std**-2.0)
        for t, (own, shares) in enumerate(zip(self.own, self.own_of_shared, strict=True)):
            shared = self.shared_of(t)
            left += shared @ (shared - shares.T @ own).T
        return np.asarray(np.linalg.inv(left))

    @cached_property
    def log_determinant(self) -> float:
        """Of the rows' covariance with these columns in it, over that of their noise alone."""
        own = -np.linalg.slogdet(self.inverse)[1].sum() + 2.0 * len(self.own) * np.log(self.own_std).sum()
        shared = -np.linalg.slogdet(self.shared_inverse)[1] + 2.0 * np.log(self.shared_std).sum()
        return float(own + shared)

    def left_of(self, y: Array) -> Array:
        """(T, N) of `y` (T, N), what own columns leave."""
        shares = np.matmul(self.inverse, np.matmul(self.own, y[..., None]))
        return np.asarray(y - np.matmul(shares.transpose(0, 2, 1), self.own)[:, 0])


def nuisance_of(load: LoadEstimate, weights: Array, priors: Priors) -> Nuisance:
    """Of one recording under `load`; `weights` (N, T): one over the standard deviation of a row; 0: unknown."""
    seen = load.observation
    assert isinstance(seen, ChamberObservation)
    every = [((column * weights).T, std) for column, std in _of_calibration(load, priors)]
    own, own_std = np.stack([column for column, _ in every], axis=1), np.array([std for _, std in every])
    late = -seen.reference.slope(seen.reference_s) * weights  # what a load is off by that comes a second late
    shared = list(_of_reference(seen, priors))
    return Nuisance(
        own, own_std, tuple(name for name, *_ in shared), np.array([std for *_, std in shared]),
        np.stack([course for _, _, course, _ in shared]), np.array([kind for _, kind, *_ in shared], np.intp),
        np.stack([weights.T, late.T]),
    )  # fmt: skip


def _of_calibration(load: LoadEstimate, priors: Priors) -> Iterator[tuple[Array, float]]:
    """Columns (N, T) and their standard deviations: gain, rest value, curves, a re-zero, a load that is uneven."""
    seen = load.observation
    assert isinstance(seen, ChamberObservation)
    # Beside a gain of the load, loose curves could say that nothing is read: they are functions of readings alone.
    is_loose = priors.has_loose_curves
    slope_pa = seen.slope_pa if is_loose else load.slope_pa
    slope = load.wrench_of(slope_pa)[..., 0]
    gain = load.wrench_of(-slope_pa * (load.activation_count if is_loose else load.gained_count))[..., 0]
    yield gain, GAIN_STD
    yield slope, ROUNDED_STD_COUNT if isinstance(seen, PairedObservation) else BASELINE_STD_COUNT
    for spline in curve_splines(load.activation_count, seen.usable).at(load.activation_count):
        yield load.wrench_of(slope_pa * spline)[..., 0], priors.curve_count
    if seen.rezeroed is not None:
        yield slope * seen.rezeroed, REZERO_STD_COUNT
    if priors.share:
        yield gain, priors.share
        for hat in _hats(seen, UNEVEN_S):
            yield gain * hat[:, None], priors.share


def _of_reference(seen: ChamberObservation, priors: Priors) -> Iterator[tuple[str, int, Array, float]]:
    """Names, kinds (0: a pressure, 1: a time), courses (N,) and standard deviations: zero, clock, a late load."""
    yield "zero", 0, np.ones(len(seen.t_s)), ZERO_STD_PA
    if seen.offset_is_free:
        yield "offset_s", 1, np.ones(len(seen.t_s)), OWN_OFFSET_STD_S
        yield "rate", 1, seen.t_s - seen.t_s.mean(), OWN_RATE_STD
    if priors.timing_s:
        for hat in _hats(seen, UNSTEADY_S):
            yield "late", 1, hat, priors.timing_s


def _hats(seen: ChamberObservation, over_s: float) -> Iterator[Array]:
    """(N,) hats over time, `over_s` apart; none of them moves all times alike."""
    knots_s = np.linspace(seen.t_s[0], seen.t_s[-1], max(round(float(np.ptp(seen.t_s)) / over_s), 1) + 1)
    for hat in np.eye(len(knots_s)):
        own = np.interp(seen.t_s, knots_s, hat)
        yield own - own.mean()
