"""One foot by both models, cycle by cycle: by its static curves alone, and with their effects undone."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..config import Board, Config, Foot
from ..mechanics.wrench import Wrench, WrenchEstimator
from ..physics.calibration import Calibration
from ..physics.dynamic import DynamicModel
from ..skin.cycles import Cycles
from ..skin.layout import Layout
from ..wire.messages import ModelName, Models


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """What one cycle is by one model."""

    t_ns: int  # of the load
    age_ns: NDArray[np.int64]  # (n_triangles,) before t_ns; -1: never received
    pressure_pa: NDArray[np.float64]  # (n_triangles, 12)
    valid: NDArray[np.bool_]
    beyond: NDArray[np.bool_]  # more than the effects were identified to
    wrench: Wrench


class DynamicFoot:
    """The dynamic model of one foot and its memory."""

    def __init__(
        self, config: Config, layout: Layout, calibration: Calibration, boards: Sequence[Board], zeroed: bool
    ) -> None:
        self._began_ns = time.time_ns()
        self._origin: tuple[int, float] | None = None  # monotonic time of the first cycle, and its second
        self._threshold_count = config.contact.activation_threshold_count
        self.model = DynamicModel(layout, calibration, boards, self._began_ns, zeroed=zeroed)
        self.model.mask(self._threshold_count)
        own = dataclasses.replace(layout, xy_m=self.model.xy_m)
        self._wrench = WrenchEstimator(own, config.contact.min_force_n, config.contact.min_pressure_pa)
        self._common_ns = int(self.model.late_ns.min())  # what all triangles are late by; the rest is their age

    def go_on(self, before: DynamicFoot) -> None:
        """With what `before` remembers, which is of the same layout and calibration."""
        self.model, self._began_ns, self._origin = before.model, before._began_ns, before._origin
        self.model.mask(self._threshold_count)

    def __call__(
        self,
        cycles: Cycles,
        at: int,
        static_pa: NDArray[np.float64],
        valid: NDArray[np.bool_],
        variance_pa2: NDArray[np.float64] | None,
    ) -> Estimate:
        """Cycle `at`, which comes after all those before; arrays (n_triangles, 12)."""
        t_mono_ns, t_ns, age_ns = int(cycles.t_mono_ns[at]), int(cycles.t_ns[at]), cycles.age_ns[at]
        if self._origin is None:
            self._origin = t_mono_ns, (t_ns - self._began_ns) * 1e-9
        first_ns, second = self._origin
        undone = self.model(
            static_pa[None], cycles.counts[at][None], valid[None], np.array([second + (t_mono_ns - first_ns) * 1e-9])
        )
        pressure_pa, own = undone.pressure_pa[0], undone.valid[0]
        if variance_pa2 is not None:
            variance_pa2 = self.model.at_places(variance_pa2[None])[0]
        return Estimate(
            t_ns - self._common_ns,
            np.where(age_ns < 0, age_ns, age_ns + (self.model.late_ns - self._common_ns)),
            pressure_pa,
            own,
            undone.beyond[0],
            self._wrench(pressure_pa, own, variance_pa2),
        )


def side_by_side(
    head: tuple[Foot, int, int, int, int], model: ModelName, static: Estimate, dynamic: Estimate, repeated: bool
) -> Models:
    """The message that says both; `head` is what stands before `model` in it."""
    a, b = static.wrench, dynamic.wrench
    return Models(
        *head, model,
        static.t_ns, a.f_z_n, a.m_x_nm, a.m_y_nm, a.cop_x_m, a.cop_y_m,
        static.pressure_pa.astype(np.float32), static.valid.view(np.uint8),
        dynamic.t_ns, b.f_z_n, b.m_x_nm, b.m_y_nm, b.cop_x_m, b.cop_y_m,
        dynamic.pressure_pa.astype(np.float32), dynamic.valid.view(np.uint8),
        dynamic.beyond.view(np.uint8), repeated,
    )  # fmt: skip
