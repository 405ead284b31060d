"""A dielectric full of air: the air goes first, and what is left is the better dielectric.

In a mixture in parallel (Wiener's upper bound) the solid's share of the volume, φ0 at rest, is φ0/(1 − s) at a strain
s. With c_0 the capacitance at rest, in counts, constant ε_r would give the activation a = c_0·s/(1 − s), so that

    u = 1/(1 − s) = 1 + a/c_0,   a ← a·(1 + ρ·u),   ρ = (ε_s − ε_a)·φ0 / (ε_a + (ε_s − ε_a)·φ0)

No further than the air is out, s = 1 − φ0; and stretched at most to twice the gap. On taxels that are `plates`, c_0
is ε_r·ε0·A/(d0·r), with ε_r that of rest.
"""

from __future__ import annotations

import numpy as np

from ..law import Array, Law, Operator, Parameter, Site, Values

_NO_SOLID = 1e-9  # of the volume: in the place of 0, where the air is never out


class _Mixture:
    """The bend, and back."""

    def __init__(self, values: Values) -> None:
        gas, solid, share = values["gas_permittivity"], values["solid_permittivity"], values["solid_share"]
        rho, rest = (solid - gas) * share / (gas + (solid - gas) * share), values["rest_count"]
        self._line, self._square = 1.0 + rho, rho / rest
        self._least, self._most = -rest / 2, rest * (1.0 / np.maximum(share, _NO_SOLID) - 1.0)

    def bent(self, a: Array) -> Array:
        a = np.clip(a, self._least, self._most)
        return a * (self._line + self._square * a)

    def straight(self, bent: Array) -> Array:
        bent = np.clip(bent, self.bent(self._least), self.bent(self._most))
        # The root that holds without a square too.
        a: Array = 2.0 * bent / (self._line + np.sqrt(self._line**2 + 4.0 * self._square * bent))
        return a


def _forward(values: Values, site: Site) -> Operator:
    mixture = _Mixture(values)
    return lambda x, moments: mixture.bent(x)


def _inverse(values: Values, site: Site) -> Operator:
    mixture = _Mixture(values)
    return lambda x, moments: mixture.straight(x)


def _wrong(values: Values) -> tuple[str, str] | None:
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
        Parameter("gas_permittivity", "1", 1.0, 10.0, (1.0, 1.01), "ε_a of what goes out"),
        Parameter("solid_permittivity", "1", 1.0, 100.0, (2.0, 4.0), "ε_s of what stays"),
        Parameter("solid_share", "1", 0.0, 0.9, (0.1, 0.4), "φ0: its share of the volume at rest"),
        Parameter("rest_count", "count", 1.0, 1e6, (50.0, 2000.0), "c_0: the capacitance at rest, in counts"),
    ),
    forward=_forward,
    inverse=_inverse,
    inverse_is="exact until all of the gas is out; beyond, as just then",
    wrong=_wrong,
)
