"""The load on every taxel from which terms compute their regressors.

If it is not known, it is estimated from noisy counts. Operators with memory follow noise at turning points, so they get
counts with reduced noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..physics.law import Array
from .observations.chamber import ChamberObservation
from .observations.wrench import WrenchObservation
from .operators import held

LINEAR_COUNT = 0.1  # shift below which a curve is taken as straight
HELD_SIGMAS = 3.0  # of the reduced noise: turns of the load that are smaller than twice this are noise
TOP = 0.9  # quantile of the taxels' largest readings: single taxels may read at the end of their range


@dataclass(frozen=True, eq=False)
class LoadEstimate:
    """Load of a recording in which it is known only in sum; arrays (N, T, 12) over rows, triangles and taxels."""

    observation: WrenchObservation
    is_known = False

    @property
    def activation_count(self) -> Array:
        """Return baseline − count with noise reduced."""
        return self.observation.smooth_count

    @property
    def gained_count(self) -> Array:
        """Return the activation (N, T, 12) that a gain multiplies."""
        return self.activation_count

    @cached_property
    def read_pa(self) -> Array:
        """Return the pressure by the static curves, from counts with noise reduced."""
        return self.static_pa(self.activation_count)

    @property
    def pressure_pa(self) -> Array:
        """Return the load; if it is not known, the pressure of the readings."""
        return self.read_pa

    def static_pa(self, activation_count: Array) -> Array:
        """Return the pressure (N, T, 12) of activations by the static curves."""
        return self.observation.static_pa(activation_count)

    def shifted_by_triangle(self, shift_count: float) -> Array:
        """Return the change (N, T, 3) of each triangle's wrench per count, averaged over a shift of `shift_count`."""
        shift_count = 0.0 if abs(shift_count) < LINEAR_COUNT else shift_count
        if shift_count not in self._shifted:
            if shift_count:
                difference_pa = self.static_pa(self.activation_count + shift_count) - self.read_pa
                change_pa = self.observation.zero_where_unloaded(difference_pa / shift_count)
            else:
                change_pa = self.slope_pa
            self._shifted[shift_count] = self.wrench_of(change_pa)
        return self._shifted[shift_count]

    @cached_property
    def _shifted(self) -> dict[float, Array]:
        return {}

    @cached_property
    def courses_pa(self) -> Array:
        """Return the loads of all taxels without repetition, (N, t, k); they broadcast to (N, T, 12)."""
        return self.pressure_pa

    @property
    def held_pa(self) -> Array:
        """Return `courses_pa` without the turns of noise, for operators that each turn changes."""
        seen = self.observation
        count = self.activation_count.reshape(len(seen.t_s), -1)
        held_count = held(count, HELD_SIGMAS * seen.smooth_noise_count.ravel())
        return self.static_pa(held_count.reshape(self.activation_count.shape))

    @cached_property
    def top_pa(self) -> float:
        """Return the load of a taxel under much of it, to which parameters of laws are relative."""
        return float(np.quantile(self.courses_pa.max(axis=0), TOP))

    def wanted(self, settings: Sequence[Mapping[str, float]]) -> list[Mapping[str, float]]:
        """Return those of the settings of joint columns that are to be computed: all."""
        return list(settings)

    def before(self, term_order: int | None) -> LoadEstimate:
        """Return the load on which a term at this place of the signal path acts: that of the readings."""
        return self

    @cached_property
    def by_triangle(self) -> Array:
        """Return the wrench (N, T, 3) of each triangle under the load."""
        return self.wrench_of(self.pressure_pa)

    @cached_property
    def slope_pa(self) -> Array:
        """Return the slope of the curves, Pa per count."""
        return self.observation.zero_where_unloaded(self.observation.slope_at(self.activation_count))

    @property
    def step_s(self) -> float:
        """Return the time between two rows."""
        return self.observation.step_s

    def wrench_of(self, pressure_pa: Array) -> Array:
        """Return the wrench (N, T, 3) under pressures (N, T, 12)."""
        return self.observation.wrench_of(pressure_pa)

    def wrench_of_courses(self, courses_pa: Array) -> Array:
        """Return the wrench (N, T, 3) under pressures that broadcast to (N, T, 12), as those of `courses_pa`."""
        return self.wrench_of(np.broadcast_to(courses_pa, self.observation.activation_count.shape))


@dataclass(frozen=True, eq=False)
class KnownLoad(LoadEstimate):
    """Load of a recording whose reference, or simulation, gives it for every taxel.

    `changes`: by how much selected terms change the load, Pa: arrays that broadcast to (N, T, 12), each with the term's
    place on the signal path (formats.md). A term acts on the load as the terms before it on the path have changed it.
    `predicted_count`: activation (N, T, 12) that a model predicts, in place of the readings.
    """

    changes: tuple[tuple[int, Array], ...] = ()
    predicted_count: Array | None = None

    is_known = True

    @property
    def activation_count(self) -> Array:
        """Return baseline − count, predicted or with noise reduced."""
        return super().activation_count if self.predicted_count is None else self.predicted_count

    def before(self, term_order: int | None) -> KnownLoad:
        """Return the load on which a term at this place of the signal path acts; None: a term beside the path."""
        if term_order is None or not any(order < term_order for order, _ in self.changes):
            return self.unchanged
        return self._before.setdefault(
            term_order, replace(self, changes=tuple(change for change in self.changes if change[0] < term_order))
        )

    def forget_before(self, term_order: int | None) -> None:
        """Free the load before a place of the signal path, after the last term there; `before` makes it again."""
        self._before.pop(term_order, None)

    @property
    def unchanged(self) -> KnownLoad:
        """Return the load of the reference, without changes."""
        return self._unchanged if self.changes else self  # a cached reference to itself would never be freed

    @cached_property
    def _unchanged(self) -> KnownLoad:
        return replace(self, changes=())

    @cached_property
    def _before(self) -> dict[int | None, KnownLoad]:
        return {}

    @property
    def pressure_pa(self) -> Array:
        """Return the load (N, T, 12) with the changes."""
        if self.courses_pa.shape[1:] == (1, 1):
            return np.broadcast_to(self.courses_pa, self.observation.activation_count.shape)
        return np.where(self.observation.usable, self.courses_pa, 0.0)

    @cached_property
    def courses_pa(self) -> Array:
        """Return the load as (N, 1, 1) if it is uniform, (N, T, 1) if triangles differ, else (N, T, 12)."""
        seen = self.observation
        assert isinstance(seen, ChamberObservation)
        return sum((change for _, change in self.changes), start=seen.load_pa(seen.reference_s))

    @cached_property
    def top_pa(self) -> float:
        """Return the largest load."""
        return float(self.courses_pa.max())

    @property
    def gained_count(self) -> Array:
        """Return the activation (N, T, 12) that the static curves have under the load."""
        return self.observation.expected_count

    @cached_property
    def slope_pa(self) -> Array:
        """Return the slope (N, T, 12) of the curves, Pa per count: mean of those at reading and expected activation."""
        seen = self.observation
        assert isinstance(seen, ChamberObservation)
        return seen.usual_slope_pa if self.predicted_count is None else seen.mean_slope_at(self.predicted_count)

    def wrench_of(self, pressure_pa: Array) -> Array:
        """Return the mean pressures (N, T, 1) of triangles, of pressures (N, T, 12)."""
        if pressure_pa.strides[1:] == (0, 0):
            return np.broadcast_to(pressure_pa[:, :1, :1], (*pressure_pa.shape[:2], 1))
        return self.observation.wrench_of(pressure_pa)


@dataclass(frozen=True, eq=False)
class TaxelLoad(KnownLoad):
    """The same load for columns of single taxels: `wrench_of` returns the pressure of each taxel.

    `only`: the settings of joint columns that are computed, because those of all taxels are large; None: all.
    """

    only: tuple[Mapping[str, float], ...] | None = None

    def wanted(self, settings: Sequence[Mapping[str, float]]) -> list[Mapping[str, float]]:
        """Return those of the settings of joint columns that are to be computed."""
        return [setting for setting in settings if self.only is None or setting in self.only]

    def wrench_of(self, pressure_pa: Array) -> Array:
        """Return pressures (N, T, 12) with 0 for taxels that are not used, in single precision to save memory."""
        return np.where(self.observation.usable, pressure_pa, 0.0).astype(np.float32)
