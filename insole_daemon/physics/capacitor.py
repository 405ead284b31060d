"""The paper's taxel: a parallel-plate capacitor on a spring, and what a mixed dielectric makes of it.

    s   = P·A / (k·d0)                     strain, (d0 − d)/d0: Hooke's F = −k·(d − d0) with F = A·P
    C_a = ε_r·ε0·A / (d0·(1 − s))
    P   = d0·k/A − ε_r·ε0·k / (r·(C_d0 − C_d) + A·ε_r·ε0/d0),   r = ΔC_a,max/ΔC_d,max

Source: Sorrentino et al. 2020, section on the taxel's theoretical model. Where the dielectric is a fabric full of air
the air goes first, and ε_r rises with the strain, as mixtures in parallel do (Wiener's upper bound):

    ε_r = ε_gas + (ε_solid − ε_gas)·φ0/(1 − s)

with φ0 the solid's share of the volume at rest; φ0 = 0 is the paper's constant.
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
    permittivity: float | Array  # ε_r of the dielectric, of its gas where it is a mixture
    solid_permittivity: float | Array = 1.0
    solid_share: float | Array = 0.0  # φ0

    def strain(self, pressure_pa: Array) -> Array:
        """(…, m) s, at most where all the gas is out and the plates have not met."""
        most = 1.0 - np.maximum(self.solid_share, _CLOSED)
        return np.minimum(pressure_pa * self.area_m2 / (self.stiffness_n_per_m * np.asarray(self.gap_m)), most)

    def capacitance_f(self, pressure_pa: Array) -> Array:
        """(…, m) C_a under `pressure_pa`."""
        squeezed = 1.0 / (1.0 - self.strain(pressure_pa))
        relative = self.permittivity + self._mixed() * squeezed
        capacitance: Array = relative * squeezed * EPSILON_0 * self.area_m2 / self.gap_m
        return capacitance

    def pressure_pa(self, capacitance_f: Array) -> Array:
        """(…, m) P of the capacitance C_a: the inverse of `capacitance_f` as far as the strain is not at its most."""
        # With u = 1/(1 − s), C·d0/(ε0·A) = ε_gas·u + mixed·u²: its positive root, in the form that holds at mixed = 0.
        scaled = capacitance_f * self.gap_m / (EPSILON_0 * np.asarray(self.area_m2))
        squeezed = 2 * scaled / (self.permittivity + np.sqrt(self.permittivity**2 + 4 * self._mixed() * scaled))
        pressure: Array = (1.0 - 1.0 / squeezed) * self.stiffness_n_per_m * self.gap_m / self.area_m2
        return pressure

    def activation_count(self, pressure_pa: Array, farad_per_count: float | Array) -> Array:
        """(…, m) C_d0 − C_d, with r = `farad_per_count`."""
        rest = self.capacitance_f(np.zeros(()))
        activation: Array = (self.capacitance_f(pressure_pa) - rest) / farad_per_count
        return activation

    def pressure_of_activation_pa(self, activation_count: Array, farad_per_count: float | Array) -> Array:
        """(…, m) P of C_d0 − C_d; with φ0 = 0 the last equation of the module."""
        return self.pressure_pa(activation_count * farad_per_count + self.capacitance_f(np.zeros(())))

    def _mixed(self) -> float | Array:
        return (self.solid_permittivity - np.asarray(self.permittivity)) * self.solid_share
