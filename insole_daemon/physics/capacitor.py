"""The paper's model of a taxel: a parallel-plate capacitor on a spring.

    s   = P·A / (k·d0)                     strain, (d0 − d)/d0: Hooke's F = −k·(d − d0) with F = A·P
    C_a = ε_r·ε0·A / (d0·(1 − s))
    P   = d0·k/A − ε_r·ε0·k / (r·(C_d0 − C_d) + A·ε_r·ε0/d0),   r = ΔC_a,max/ΔC_d,max

Source: Sorrentino et al. 2020, section on the taxel's theoretical model. For a dielectric whose ε_r increases with the
strain, see `effects/permittivity.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .law import Array

EPSILON_0 = 8.8541878128e-12  # F/m
_CLOSED = 1e-9  # smallest gap, as a fraction of d0: the plates never touch


@dataclass(frozen=True, slots=True)
class Capacitor:
    """One kind of taxel, or m of them if the fields are arrays (m,)."""

    area_m2: float | Array
    gap_m: float | Array  # d0
    stiffness_n_per_m: float | Array  # k
    permittivity: float | Array  # ε_r

    def rest_f(self) -> float | Array:
        """Return C_a without load, in F."""
        return self.permittivity * EPSILON_0 * self.area_m2 / self.gap_m

    def closing_pa(self) -> float | Array:
        """Return the load at which the plates would touch, d0·k/A."""
        return self.gap_m * np.asarray(self.stiffness_n_per_m) / self.area_m2

    def activation_count(self, pressure_pa: Array, farad_per_count: float | Array) -> Array:
        """Return (…, m) C_d0 − C_d at the load `pressure_pa`, with r = `farad_per_count`."""
        strain = np.minimum(pressure_pa / self.closing_pa(), 1.0 - _CLOSED)
        activation: Array = self.rest_f() / farad_per_count * strain / (1.0 - strain)
        return activation

    def pressure_pa(self, activation_count: Array, farad_per_count: float | Array) -> Array:
        """Return (…, m) the load P at C_d0 − C_d, by the last equation of the module."""
        ratio = 1.0 + activation_count * farad_per_count / self.rest_f()
        pressure: Array = (1.0 - 1.0 / ratio) * self.closing_pa()
        return pressure
