"""The paper's taxel: a parallel-plate capacitor on a spring.

    s   = P·A / (k·d0)                     strain, (d0 − d)/d0: Hooke's F = −k·(d − d0) with F = A·P
    C_a = ε_r·ε0·A / (d0·(1 − s))
    P   = d0·k/A − ε_r·ε0·k / (r·(C_d0 − C_d) + A·ε_r·ε0/d0),   r = ΔC_a,max/ΔC_d,max

Source: Sorrentino et al. 2020, section on the taxel's theoretical model. Of a dielectric whose ε_r rises with the
strain, see `effects/permittivity.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .law import Array

EPSILON_0 = 8.8541878128e-12  # F/m
_CLOSED = 1e-9  # of the gap: the plates never touch


@dataclass(frozen=True, slots=True)
class Capacitor:
    """Taxels of equal build, or of (m,) builds where the fields are arrays."""

    area_m2: float | Array
    gap_m: float | Array  # d0
    stiffness_n_per_m: float | Array  # k
    permittivity: float | Array  # ε_r

    def rest_f(self) -> float | Array:
        """C_a of no load."""
        return self.permittivity * EPSILON_0 * self.area_m2 / self.gap_m

    def closing_pa(self) -> float | Array:
        """The load that would bring the plates together, d0·k/A."""
        return self.gap_m * np.asarray(self.stiffness_n_per_m) / self.area_m2

    def activation_count(self, pressure_pa: Array, farad_per_count: float | Array) -> Array:
        """(…, m) C_d0 − C_d under `pressure_pa`, with r = `farad_per_count`."""
        strain = np.minimum(pressure_pa / self.closing_pa(), 1.0 - _CLOSED)
        activation: Array = self.rest_f() / farad_per_count * strain / (1.0 - strain)
        return activation

    def pressure_pa(self, activation_count: Array, farad_per_count: float | Array) -> Array:
        """(…, m) P of C_d0 − C_d: the last equation of the module."""
        ratio = 1.0 + activation_count * farad_per_count / self.rest_f()
        pressure: Array = (1.0 - 1.0 / ratio) * self.closing_pa()
        return pressure
