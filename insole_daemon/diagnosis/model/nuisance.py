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
    shared: Array  # (T, s, N) of the reference
    shared_std: Array  # (s,)

    @cached_property
    def inverse(self) -> Array:
        """(T, b, b) of the own columns' inner products with their priors."""
        return np.linalg.inv(np.matmul(self.own, self.own.transpose(0, 2, 1)) + np.diag(self.own_std**-2.0))

    @cached_property
    def own_single(self) -> NDArray[np.float32]:
        """(T, b, N) of the own columns, in the precision of the columns of terms."""
        return self.own.astype(np.float32)

    @cached_property
    def _own_of_shared(self) -> Array:
        """(T, b, s) shares of the own columns in the reference's."""
        return np.asarray(np.matmul(self.inverse, np.matmul(self.own, self.shared.transpose(0, 2, 1))))

    @cached_property
    def shared_left_single(self) -> NDArray[np.float32]:
        """(T, s, N) of the reference's columns, what own columns leave."""
        found = np.empty(self.shared.shape, np.float32)
        for t, (shared, own, shares) in enumerate(zip(self.shared, self.own, self._own_of_shared, strict=True)):
            found[t] = shared - shares.T @ own
        return found

    @cached_property
    def shared_inverse(self) -> Array:
        """(s, s) of the reference's columns' inner products with their priors, own columns projected out."""
        left = np.diag(self.shared_std**-2.0)
        for shared, own, shares in zip(self.shared, self.own, self._own_of_shared, strict=True):
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
    names, shared, shared_std = _of_reference(seen, weights, priors)
    every = list(_of_calibration(load, priors))
    own = np.stack([(column * weights).T for column, _ in every], axis=1)
    return Nuisance(own, np.array([std for _, std in every]), names, shared, shared_std)


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
        for column in (gain, *_over_time(seen, gain, UNEVEN_S)):
            yield column, priors.share


def _of_reference(seen: ChamberObservation, weights: Array, priors: Priors) -> tuple[tuple[str, ...], Array, Array]:
    """Names, columns (T, s, N) and standard deviations (s,): zero, clock, and when a simulated load comes late."""
    edge = seen.reference.slope(seen.reference_s)  # (N, 1), or (N, T) of a load that differs
    names, columns, std = ["zero"], [np.ones((len(weights), 1))], [ZERO_STD_PA]
    if seen.offset_is_free:
        names += ["offset_s", "rate"]
        columns += [-edge, -edge * (seen.t_s - seen.t_s.mean())[:, None]]
        std += [OWN_OFFSET_STD_S, OWN_RATE_STD]
    if priors.timing_s:
        late = list(_over_time(seen, -edge, UNSTEADY_S))
        names += ["late"] * len(late)
        columns += late
        std += [priors.timing_s] * len(late)
    return tuple(names), np.stack([(column * weights).T for column in columns], axis=1), np.array(std)


def _over_time(seen: ChamberObservation, column: Array, over_s: float) -> Iterator[Array]:
    """`column` times hats over time, `over_s` apart; none of them moves all times alike."""
    knots_s = np.linspace(seen.t_s[0], seen.t_s[-1], max(round(float(np.ptp(seen.t_s)) / over_s), 1) + 1)
    for hat in np.eye(len(knots_s)):
        own = np.interp(seen.t_s, knots_s, hat)
        yield column * (own - own.mean())[:, None]
