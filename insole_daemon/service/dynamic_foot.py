"""The dynamic model of one foot, cycle by cycle, and its results beside those of the static curves."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from ..config import Board, Config
from ..mechanics.static_model import StaticEstimate, age_in_ms
from ..mechanics.wrench import Wrench, WrenchEstimator
from ..physics.calibration import Calibration
from ..physics.cycle_inverse import CycleInverse
from ..physics.dynamic import DynamicModel
from ..skin.cycles import Cycles
from ..skin.layout import Layout
from ..wire.messages import ModelName, Models, Raw


@dataclass(frozen=True, slots=True, eq=False)
class DynamicEstimate:
    """The estimate of the dynamic model for one cycle."""

    t_ns: int  # of the load
    age_ms: NDArray[np.float32]  # (n_triangles,) relative to t_ns; NaN: never received
    pressure_pa: NDArray[np.float64]  # (n_triangles, 12)
    valid: NDArray[np.bool_]
    beyond: NDArray[np.bool_]  # beyond the range on which the effects were identified
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
        self._invert = CycleInverse(self.model)
        moved_layout = dataclasses.replace(layout, xy_m=self.model.xy_m)
        self._estimator = WrenchEstimator(moved_layout, config.contact.min_force_n, config.contact.min_pressure_pa)
        self.common_ns = int(self.model.late_ns.min())  # delay of all triangles; the rest counts as age

    def take_state(self, before: DynamicFoot) -> None:
        """Continue with the state of `before`, which has the same layout and calibration."""
        self.model, self._invert = before.model, before._invert
        self._began_ns, self._origin = before._began_ns, before._origin
        self.model.mask(self._threshold_count)

    def __call__(self, cycles: Cycles, at: int, static: StaticEstimate) -> DynamicEstimate:
        """Return the estimate for row `at`, the next cycle in order; `static` is that of the static curves."""
        t_ns, age_ns = int(cycles.t_ns[at]), cycles.age_ns[at]
        t_s = self._seconds(int(cycles.t_mono_ns[at]), t_ns)
        inverted = self._invert(static.pressure_pa, cycles.counts[at], static.valid, t_s)
        pressure_pa, valid = inverted.pressure_pa, inverted.valid
        variance_pa2 = static.variance_pa2
        if variance_pa2 is not None:
            variance_pa2 = self.model.at_places(variance_pa2[None])[0]
        return DynamicEstimate(
            t_ns - self.common_ns,
            age_in_ms(np.where(age_ns < 0, age_ns, age_ns + (self.model.late_ns - self.common_ns))),
            pressure_pa,
            valid,
            inverted.beyond,
            self._estimator(pressure_pa, valid, variance_pa2),
        )

    @property
    def is_compiled(self) -> bool:
        """Whether `invert` and `wrench` may be used: the kernel has all effects, and all triangles are equally late."""
        return self._invert.is_compiled and bool(np.all(self.model.late_ns == self.common_ns))

    def invert(
        self,
        t_mono_ns: int,
        t_ns: int,
        static_pa: NDArray[np.float64],
        counts: memoryview | NDArray[np.uint8],
        valid: NDArray[np.bool_],
        pressure_pa: NDArray[np.float64],
        beyond: NDArray[np.uint8],
    ) -> int:
        """Do for the next cycle what a call does, into the last two arrays; return how many taxels are beyond."""
        return self._invert.into(static_pa, counts, valid, self._seconds(t_mono_ns, t_ns), pressure_pa, beyond)

    def wrench(
        self,
        pressure_pa: NDArray[np.float64],
        valid: NDArray[np.bool_],
        variance_pa2: NDArray[np.float64] | None,
        pressure_pa_f4: NDArray[np.float32],
    ) -> Wrench:
        """Return the wrench of what `invert` estimated, and write the pressure as it is published into the last."""
        n_valid, n_in_contact, f_z, m_x, m_y = kernel.sum(
            pressure_pa, valid, self._estimator.rows, self._estimator.min_pressure_pa, pressure_pa_f4
        )
        return self._estimator.of_sums(f_z, m_x, m_y, n_valid, n_in_contact, pressure_pa, valid, variance_pa2)

    def _seconds(self, t_mono_ns: int, t_ns: int) -> float:
        """Return the time of a cycle since the model began, on the monotonic clock."""
        if self._origin is None:
            self._origin = t_mono_ns, (t_ns - self._began_ns) * 1e-9
        first_ns, second = self._origin
        return second + (t_mono_ns - first_ns) * 1e-9


def side_by_side(raw: Raw, model: ModelName, static: StaticEstimate, dynamic: DynamicEstimate) -> Models:
    """Return the message with both estimates of the cycle of `raw`; `model` is the one in pressure and wrench."""
    a, b = static.wrench, dynamic.wrench
    return Models(
        foot=raw.foot,
        seq=raw.seq,
        started_ns=raw.started_ns,
        t_published_ns=raw.t_published_ns,
        n_triangles=raw.n_triangles,
        model=model,
        static_t_ns=raw.t_ns,
        static_f_z_n=a.f_z_n,
        static_m_x_nm=a.m_x_nm,
        static_m_y_nm=a.m_y_nm,
        static_cop_x_m=a.cop_x_m,
        static_cop_y_m=a.cop_y_m,
        static_pressure_pa=static.pressure_pa_f4,
        static_valid=static.valid.view(np.uint8),
        dynamic_t_ns=dynamic.t_ns,
        dynamic_f_z_n=b.f_z_n,
        dynamic_m_x_nm=b.m_x_nm,
        dynamic_m_y_nm=b.m_y_nm,
        dynamic_cop_x_m=b.cop_x_m,
        dynamic_cop_y_m=b.cop_y_m,
        dynamic_pressure_pa=dynamic.pressure_pa.astype(np.float32),
        dynamic_valid=dynamic.valid.view(np.uint8),
        beyond=dynamic.beyond.view(np.uint8),
        repeated=raw.repeated,
    )
