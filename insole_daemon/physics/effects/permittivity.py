"""Permittivity: a dielectric with air in it, which leaves first under load, so the permittivity increases.

In a parallel mixture (Wiener's upper bound) the solid's volume fraction, φ0 without load, is φ0/(1 − s) at a strain s.
With c_0 the unloaded capacitance in counts, a constant ε_r would give the activation a = c_0·s/(1 − s), so that

    u = 1/(1 − s) = 1 + a/c_0,   a ← a·(1 + ρ·u),   ρ = (ε_s − ε_a)·φ0 / (ε_a + (ε_s − ε_a)·φ0)

This holds until the air has left, at s = 1 − φ0, and down to a stretch of twice the gap. For taxels that are `plates`,
c_0 is ε_r·ε0·A/(d0·r), with the unloaded ε_r.
"""

from __future__ import annotations

import numpy as np

from ..law import Array, Law, Operator, Parameter, Site, Values

_NO_SOLID = 1e-9  # volume fraction used instead of 0, for which the air would never have left


class _Mixture:
    """The mapping of the activation, and its inverse."""

    def __init__(self, values: Values) -> None:
        gas, solid, share = values["gas_permittivity"], values["solid_permittivity"], values["solid_share"]
        rho, rest = (solid - gas) * share / (gas + (solid - gas) * share), values["rest_count"]
        self._line, self._square = 1.0 + rho, rho / rest
        self._lowest, self._highest = -rest / 2, rest * (1.0 / np.maximum(share, _NO_SOLID) - 1.0)

    def bend(self, a: Array) -> Array:
        """Return the activation of the mixture for the activation of a constant dielectric."""
        a = np.clip(a, self._lowest, self._highest)
        return a * (self._line + self._square * a)

    def straighten(self, bent: Array) -> Array:
        """Return the inverse of `bend`."""
        bent = np.clip(bent, self.bend(self._lowest), self.bend(self._highest))
        # This form of the root is also valid without a quadratic term.
        a: Array = 2.0 * bent / (self._line + np.sqrt(self._line**2 + 4.0 * self._square * bent))
        return a


def _forward(values: Values, site: Site) -> Operator:
    mixture = _Mixture(values)
    return lambda x, moments: mixture.bend(x)


def _inverse(values: Values, site: Site) -> Operator:
    mixture = _Mixture(values)
    return lambda x, moments: mixture.straighten(x)


def _find_problem(values: Values) -> tuple[str, str] | None:
    gas, solid = np.broadcast_arrays(values["gas_permittivity"], values["solid_permittivity"])
    if (solid >= gas).all():
        return None
    i = int(np.argmax(solid < gas))
    return (
        "solid_permittivity",
        f"expected at least gas_permittivity, which is {gas.flat[i]:g}, found {solid.flat[i]:g}",
    )


LAW = Law(
    word="permittivity",
    order=7,
    domain="activation",
    equation="ε_r = ε_a + (ε_s − ε_a)·φ0/(1 − s): a ← a·(1 + ρ·u), with a = baseline − c and u = 1/(1 − s) = 1 + a/c_0",
    source="O. Wiener, Abh. Sächs. Ges. Wiss. 32 (1912) 507–604; ε_r rises with the load: Sorrentino et al. 2020",
    parameters=(
        Parameter("gas_permittivity", "1", 1.0, 10.0, (1.0, 1.01), "ε_a of the gas"),
        Parameter("solid_permittivity", "1", 1.0, 100.0, (2.0, 4.0), "ε_s of the solid"),
        Parameter("solid_share", "1", 0.0, 0.9, (0.1, 0.4), "φ0: the solid's volume fraction without load"),
        Parameter("rest_count", "count", 1.0, 1e6, (50.0, 2000.0), "c_0: the capacitance without load, in counts"),
    ),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact until all gas has left; beyond, clipped to that state",
    find_problem=_find_problem,
)
