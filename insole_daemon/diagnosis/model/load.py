"""The load on every taxel, as its own noisy counts tell it.

Memory of turning points follows noise: columns of such terms need counts with less of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from ...physics.law import Array
from ..observations.chamber import ChamberObservation
from ..observations.wrench import WrenchObservation

LINEAR_COUNT = 0.1  # over which curves are straight


@dataclass(frozen=True, eq=False)
class LoadEstimate:
    """Arrays (N, T, 12) over rows, triangles and taxels."""

    observation: WrenchObservation
    is_known = False

    @property
    def activation_count(self) -> Array:
        """Baseline − count with noise reduced."""
        return self.observation.smooth_count

    @property
    def gained_count(self) -> Array:
        """(N, T, 12) activation that a gain multiplies."""
        return self.activation_count

    @cached_property
    def read_pa(self) -> Array:
        """By the static curves, from counts with noise reduced."""
        return self.static_pa(self.activation_count)

    @cached_property
    def pressure_pa(self) -> Array:
        """The load: where it is not known, what the readings say."""
        return self.read_pa

    def static_pa(self, activation_count: Array) -> Array:
        """(N, T, 12) by the static curves, of activations."""
        return self.observation.static_pa(activation_count)

    def shifted_by_triangle(self, shift_count: float) -> Array:
        """(N, T, 3) by which the wrench of each triangle differs for a count more, on the mean over `shift_count`."""
        shift_count = 0.0 if abs(shift_count) < LINEAR_COUNT else shift_count
        if shift_count not in self._shifted:
            shifted_pa = self.slope_pa
            if shift_count:
                differs = self.static_pa(self.activation_count + shift_count) - self.read_pa
                shifted_pa = self.observation.zero_where_unloaded(differs / shift_count)
            self._shifted[shift_count] = self.wrench_of(shifted_pa)
        return self._shifted[shift_count]

    @cached_property
    def _shifted(self) -> dict[float, Array]:
        return {}

    @cached_property
    def courses_pa(self) -> Array:
        """(N, t, k) loads of all taxels, those that are the same once; they broadcast to (N, T, 12)."""
        return self.pressure_pa

    def before(self, term_order: int | None) -> LoadEstimate:
        """The load on which a term at this place on the signal path acts: where it is not known, the readings'."""
        return self

    @cached_property
    def by_triangle(self) -> Array:
        """(N, T, 3) wrench of each triangle by the load."""
        return self.wrench_of(self.pressure_pa)

    @cached_property
    def slope_pa(self) -> Array:
        """Pa a count, no flatter than a share of its mean."""
        return self.observation.zero_where_unloaded(self.observation.slope_at(self.activation_count))

    def released(self) -> Self:
        """The same, without the arrays that were computed of it and of its observation."""
        return replace(self, observation=self.observation.timed())

    @property
    def step_s(self) -> float:
        """Between two rows."""
        return self.observation.step_s

    def wrench_of(self, pressure_pa: Array) -> Array:
        """(N, T, 3) of pressures (N, T, 12)."""
        return self.observation.wrench_of(pressure_pa)

    def wrench_of_courses(self, courses_pa: Array) -> Array:
        """(N, T, 3) of pressures that broadcast to (N, T, 12), as `courses_pa` does."""
        return self.wrench_of(np.broadcast_to(courses_pa, self.pressure_pa.shape))


@dataclass(frozen=True, eq=False)
class KnownLoad(LoadEstimate):
    """Where a reference tells the load of every taxel: what acts on it is computed from it, not from readings.

    `changes`: by how much selected terms change the load, Pa, arrays that broadcast to (N, T, 12), each with the term's
    place on the signal path (formats.md). A term acts on the load as the terms before it on the path have changed it.
    """

    changes: tuple[tuple[int, Array], ...] = ()

    is_known = True

    def before(self, term_order: int | None) -> KnownLoad:
        """The load on which a term at this place on the signal path acts; None: a term beside the path."""
        if term_order is None or not any(order < term_order for order, _ in self.changes):
            return self.unchanged
        return self._before.setdefault(
            term_order, replace(self, changes=tuple(each for each in self.changes if each[0] < term_order))
        )

    @property
    def unchanged(self) -> KnownLoad:
        """The load of the reference itself."""
        return self._unchanged if self.changes else self  # kept by itself, it and its arrays would never go

    @cached_property
    def _unchanged(self) -> KnownLoad:
        return replace(self, changes=())

    @cached_property
    def _before(self) -> dict[int, KnownLoad]:
        return {}

    @cached_property
    def pressure_pa(self) -> Array:
        """(N, T, 12) of the reference, with the changes; of a load that is the same everywhere, on every taxel."""
        if self.courses_pa.shape[1:] == (1, 1):
            return np.broadcast_to(self.courses_pa, self.observation.activation_count.shape)
        return np.where(self.observation.usable, self.courses_pa, 0.0)

    @cached_property
    def courses_pa(self) -> Array:
        """(N, 1, 1) where all taxels bear the same load, (N, T, 1) where triangles differ, else (N, T, 12)."""
        seen = self.observation
        assert isinstance(seen, ChamberObservation)
        return sum((change for _, change in self.changes), start=seen.load_pa(seen.reference_s))

    @property
    def gained_count(self) -> Array:
        """(N, T, 12) activation that the load makes."""
        return self.observation.expected_count

    @cached_property
    def slope_pa(self) -> Array:
        """(N, T, 12) Pa a count between what is read and what should be: their mean, as a shift moves pressures."""
        seen = self.observation
        found = seen.slope_at(self.activation_count)
        found += seen.slope_at(seen.expected_count)
        found *= 0.5
        return found

    def wrench_of(self, pressure_pa: Array) -> Array:
        """(N, T, 1) mean pressures of triangles, of pressures (N, T, 12); where all are the same, that pressure."""
        if pressure_pa.strides[1:] == (0, 0):
            return np.broadcast_to(pressure_pa[:, :1, :1], (*pressure_pa.shape[:2], 1))
        return self.observation.wrench_of(pressure_pa)


@dataclass(frozen=True, eq=False)
class TaxelLoad(KnownLoad):
    """The same, for columns of single taxels: what else sums up to a triangle's mean stays (N, T, 12)."""

    def wrench_of(self, pressure_pa: Array) -> Array:
        """(N, T, 12) of pressures (N, T, 12)."""
        return np.where(self.observation.usable, pressure_pa, 0.0)
