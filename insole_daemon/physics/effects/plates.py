"""Plates: the paper's capacitor on a spring, with its own constants, instead of the static curve.

The calibration's curve still applies to the taxels without this effect, and its baseline to all taxels. A reading for
which the gap would be more than FARTHEST times the unloaded gap is clipped to that.
"""

from __future__ import annotations

import numpy as np

from ..capacitor import Capacitor
from ..law import Array, Law, Moments, Operator, Parameter, Site, Values

FARTHEST = 1e6


def _capacitors(values: Values) -> tuple[Capacitor, Array]:
    """Return the capacitors, and r in F per count."""
    plates = Capacitor(
        values["area_mm2"] * 1e-6, values["gap_mm"] * 1e-3, values["stiffness_n_per_m"], values["permittivity"]
    )
    return plates, values["ff_per_count"] * 1e-15


def _forward(values: Values, site: Site) -> Operator:
    plates, farad_per_count = _capacitors(values)
    return lambda x, moments: plates.activation_count(x, farad_per_count)


def _inverse(values: Values, site: Site) -> Operator:
    plates, farad_per_count = _capacitors(values)
    lowest_count = (1.0 / FARTHEST - 1.0) * plates.rest_f() / farad_per_count

    def inverse(x: Array, moments: Moments) -> Array:
        return plates.pressure_pa(np.maximum(x, lowest_count), farad_per_count)

    return inverse


LAW = Law(
    word="plates",
    order=7,
    domain="curve",
    equation="P = d0·k/A − ε_r·ε0·k / (r·(baseline − c) + A·ε_r·ε0/d0)",
    source="Sorrentino et al. 2020, the taxel's theoretical model, its last equation",
    parameters=(
        Parameter("area_mm2", "mm2", 1.0, 1000.0, (15.0, 35.0), "A of an electrode"),
        Parameter("gap_mm", "mm", 0.1, 50.0, (1.0, 5.0), "d0 between the plates without load"),
        Parameter("stiffness_n_per_m", "N/m", 10.0, 1e8, (3_000.0, 30_000.0), "k of the spring"),
        Parameter("permittivity", "1", 1.0, 100.0, (1.3, 2.5), "ε_r of the dielectric"),
        Parameter(
            "ff_per_count", "fF", 1e-3, 1e3, (0.12, 4.0), "r: capacitance per count; 0.12 · 2^shift in the paper"
        ),
    ),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact until the plates meet",
)
