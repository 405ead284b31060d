"""Pressure into wrench, centre of pressure and contact area.

With the pressure P_i of a taxel, the area A it stands for and its position (x_i, y_i), x forward, y to the
wearer's left, z up:

    f_z = Σ P_i A      m_x = Σ y_i P_i A      m_y = −Σ x_i P_i A      CoP = (−m_y / f_z, m_x / f_z)

(Sorrentino et al. 2020, with the signs that make its CoP equations true.)

Taxels that are not valid count nothing. What they may bear (missing_area.py) is added in squares to the standard
deviations that come from the calibration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..skin.geometry import THERMAL_PADS
from ..skin.layout import Layout
from .missing_area import MissingArea


class Wrench(NamedTuple):
    """Load of the ground on one foot; NaN where it cannot be known."""

    f_z_n: float  # NaN: no taxel is valid
    m_x_nm: float
    m_y_nm: float
    cop_x_m: float  # NaN below the contact force
    cop_y_m: float
    f_z_std_n: float  # NaN: the calibration carries no uncertainty, and no taxel is missing
    m_x_std_nm: float
    m_y_std_nm: float
    contact_area_m2: float
    valid_fraction: float  # area of the valid taxels over that of all pressure taxels


@dataclass(frozen=True, slots=True, eq=False)
class WrenchSeries:
    """The wrenches of n cycles, every array (n,); NaN where a `Wrench` has it."""

    f_z_n: NDArray[np.float64]
    m_x_nm: NDArray[np.float64]
    m_y_nm: NDArray[np.float64]
    cop_x_m: NDArray[np.float64]
    cop_y_m: NDArray[np.float64]
    f_z_std_n: NDArray[np.float64]
    m_x_std_nm: NDArray[np.float64]
    m_y_std_nm: NDArray[np.float64]
    contact_area_m2: NDArray[np.float64]
    valid_fraction: NDArray[np.float64]

    def __len__(self) -> int:
        """Return the number of cycles."""
        return len(self.f_z_n)

    @classmethod
    def concatenate(cls, pieces: Sequence[WrenchSeries]) -> WrenchSeries:
        """Return `pieces`, which are consecutive, as one series; an empty one if there are none."""
        none = [np.empty(0)]
        return cls(*(np.concatenate([getattr(piece, name) for piece in pieces] or none) for name in cls.__slots__))


_NAN = float("nan")


class WrenchEstimator:
    """Computes the wrench from the pressure of one foot.

    The CoP is unknown below `min_force_n`; a taxel is in contact from `min_pressure_pa`.
    """

    def __init__(self, layout: Layout, min_force_n: float, min_pressure_pa: float) -> None:
        x, y = layout.xy_m[..., 0].ravel(), layout.xy_m[..., 1].ravel()
        self._area_m2 = layout.taxel_area_m2
        self.rows = self._area_m2 * np.stack([np.ones_like(x), y, -x])  # (3, n_triangles · 12)
        self._rows_squared = self.rows**2
        self._missing = MissingArea(layout, self.rows)
        self._n_taxels = len(layout.triangles) * (12 - len(THERMAL_PADS))
        self._min_force_n = min_force_n
        self.min_pressure_pa = min_pressure_pa

    def __call__(
        self,
        pressure_pa: NDArray[np.float64],
        valid: NDArray[np.bool_],
        variance_pa2: NDArray[np.float64] | None,
    ) -> Wrench:
        """Return the wrench of one cycle.

        `pressure_pa` in Pa, `valid` and `variance_pa2` in Pa² are (n_triangles, 12); invalid taxels count as 0 Pa.
        """
        pressure = np.where(valid, pressure_pa, 0.0).ravel()
        # Not a matrix product: for so few numbers BLAS costs more to wake than to use.
        f_z, m_x, m_y = np.add.reduce(self.rows * pressure, axis=1).tolist()
        n_in_contact = int(np.count_nonzero(valid.ravel() & (pressure >= self.min_pressure_pa)))
        return self.of_sums(
            f_z, m_x, m_y, int(np.count_nonzero(valid)), n_in_contact, pressure_pa, valid, variance_pa2
        )  # fmt: skip

    def of_sums(
        self,
        f_z: float,
        m_x: float,
        m_y: float,
        n_valid: int,
        n_in_contact: int,
        pressure_pa: NDArray[np.float64],
        valid: NDArray[np.bool_],
        variance_pa2: NDArray[np.float64] | None,
    ) -> Wrench:
        """Return what a call returns, from sums over the valid taxels that are known.

        `f_z` in N, `m_x` and `m_y` in N·m; `n_valid` taxels are valid, and `n_in_contact` of them in contact.
        """
        if n_valid == 0:
            return Wrench(_NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, 0.0, 0.0)
        std = [_NAN, _NAN, _NAN]
        if variance_pa2 is not None or n_valid < self._n_taxels:
            pressure = np.where(valid, pressure_pa, 0.0).ravel()
            std = self._std(pressure, valid, variance_pa2, n_valid).tolist()
        in_contact = f_z > 0 and f_z >= self._min_force_n  # which may be 0: no force has no centre
        return Wrench(
            f_z, m_x, m_y,
            -m_y / f_z if in_contact else _NAN,
            m_x / f_z if in_contact else _NAN,
            std[0], std[1], std[2],
            n_in_contact * self._area_m2,
            n_valid / self._n_taxels,
        )  # fmt: skip

    def _std(
        self,
        pressure: NDArray[np.float64],
        valid: NDArray[np.bool_],
        variance_pa2: NDArray[np.float64] | None,
        n_valid: int,
    ) -> NDArray[np.float64]:
        """Return the standard deviations (3,) of f_z in N, m_x and m_y in N·m.

        They come from the calibration and from missing taxels; `pressure` (12 · n_triangles,) in Pa.
        """
        variance = np.zeros(3)
        if variance_pa2 is not None:
            variance += self._rows_squared @ np.where(valid, variance_pa2, 0.0).ravel()
        if n_valid < self._n_taxels:
            variance += self._missing(pressure, valid.ravel()) ** 2
        return np.sqrt(variance)

    def series(
        self,
        pressure_pa: NDArray[np.float64],
        valid: NDArray[np.bool_],
        variance_pa2: NDArray[np.float64] | None,
    ) -> WrenchSeries:
        """Return the wrenches of n cycles, cycle for cycle what a call returns; arguments (n, n_triangles, 12)."""
        n = len(pressure_pa)
        n_valid = np.count_nonzero(valid.reshape(n, -1), axis=1)
        known = n_valid > 0
        pressure = np.where(valid, pressure_pa, 0.0).reshape(n, -1)
        wrench = np.add.reduce(self.rows[:, None] * pressure, axis=2)
        wrench[:, ~known] = _NAN
        std = np.full((3, n), _NAN)
        stated = known if variance_pa2 is not None else known & (n_valid < self._n_taxels)
        for row in np.flatnonzero(stated).tolist():
            variance = variance_pa2[row] if variance_pa2 is not None else None
            std[:, row] = self._std(pressure[row], valid[row], variance, int(n_valid[row]))
        f_z, m_x, m_y = wrench
        in_contact = (f_z > 0) & (f_z >= self._min_force_n)
        force = np.where(in_contact, f_z, _NAN)
        touched = np.count_nonzero(valid.reshape(n, -1) & (pressure >= self.min_pressure_pa), axis=1)
        return WrenchSeries(
            f_z, m_x, m_y, -m_y / force, m_x / force, std[0], std[1], std[2],
            touched * self._area_m2, n_valid / self._n_taxels,
        )  # fmt: skip
