"""One cycle by the static curves: counts into valid taxels, pressure and wrench."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from ..physics.calibration import Calibration
from ..physics.static_curve import StaticCurve
from ..skin.validity import Validity
from .wrench import Wrench, WrenchEstimator


class StaticEstimate(NamedTuple):
    """Result of the static curves for one cycle; arrays (n_triangles, 12) but for the ages."""

    valid: NDArray[np.bool_]
    pressure_pa: NDArray[np.float64]  # NaN where the calibration lists no taxel
    pressure_pa_f4: NDArray[np.float32]  # the same, as it is published
    variance_pa2: NDArray[np.float64] | None  # None where the calibration carries no uncertainty
    wrench: Wrench
    age_ms: NDArray[np.float32]  # (n_triangles,) NaN: never received
    extrapolated: bool  # a valid taxel reads beyond what its curve was fitted to


class StaticModel:
    """The static model of one foot.

    The kernel computes valid taxels, pressure and sums in one pass where there is one, and numpy in some forty steps
    elsewhere, with the same results to the bit.
    """

    def __init__(
        self, calibration: Calibration, validity: Validity, curve: StaticCurve, wrench: WrenchEstimator
    ) -> None:
        """`validity`, `curve` and `wrench`: of the same foot, with `calibration`."""
        self._validity, self._curve, self._wrench = validity, curve, wrench
        self._lowest_count = calibration.lowest_count
        self._shape = calibration.usable.shape
        self.reader = None  # the kernel's, with the constants of this model
        if kernel is not None:
            lowest = np.zeros(self._shape) if self._lowest_count is None else self._lowest_count.astype(np.float64)
            self.reader = kernel.reader(
                (
                    calibration.usable, *validity.of_triangles(), calibration.baseline_count, curve.coefficients,
                    lowest, wrench.rows,
                ),
                len(curve.coefficients), validity.stale_after_ns, curve.threshold_count, wrench.min_pressure_pa,
            )  # fmt: skip

    def __call__(
        self,
        counts: NDArray[np.uint8],
        status: NDArray[np.uint16],
        age_ns: NDArray[np.int64],
        masked: NDArray[np.bool_],
    ) -> StaticEstimate:
        """Return the estimate of one cycle.

        `counts` and `masked`, the taxels to leave out, are (n_triangles, 12); `status` and `age_ns` (n_triangles,).
        """
        if self.reader is None:
            return self._by_numpy(counts, status, age_ns, masked)
        valid, age_ms = np.empty(self._shape, np.bool_), np.empty(len(age_ns), np.float32)
        pressure_pa, pressure_pa_f4 = np.empty(self._shape), np.empty(self._shape, np.float32)
        extrapolated, n_valid, n_in_contact, f_z, m_x, m_y = kernel.read(
            self.reader, counts, status, age_ns, masked, valid, pressure_pa, pressure_pa_f4, age_ms
        )
        variance_pa2 = self._curve.variance_pa2(counts)
        wrench = self._wrench.of_sums(f_z, m_x, m_y, n_valid, n_in_contact, pressure_pa, valid, variance_pa2)
        return StaticEstimate(valid, pressure_pa, pressure_pa_f4, variance_pa2, wrench, age_ms, bool(extrapolated))

    def _by_numpy(
        self,
        counts: NDArray[np.uint8],
        status: NDArray[np.uint16],
        age_ns: NDArray[np.int64],
        masked: NDArray[np.bool_],
    ) -> StaticEstimate:
        valid = self._validity(counts, status, age_ns) & self._curve.usable & ~masked
        extrapolated = self._lowest_count is not None and bool(np.count_nonzero((counts < self._lowest_count) & valid))
        pressure_pa, variance_pa2 = self._curve.pressure_pa(counts), self._curve.variance_pa2(counts)
        return StaticEstimate(
            valid,
            pressure_pa,
            pressure_pa.astype(np.float32),
            variance_pa2,
            self._wrench(pressure_pa, valid, variance_pa2),
            age_in_ms(age_ns),
            extrapolated,
        )


def age_in_ms(age_ns: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return ages (n,) in ms of `age_ns` (n,); a negative one, of what was never received, becomes NaN."""
    age_ms = (age_ns * 1e-6).astype(np.float32)
    never = age_ns < 0
    if np.count_nonzero(never):
        age_ms[never] = np.nan
    return age_ms
