"""What was found in the words of a chain that runs it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ...errors import EffectError
from ...physics.effect import Effect, Where, effect
from ...physics.effects import laws
from ...physics.law import MOST_SHARED, Array
from ...skin.geometry import N_TAXELS
from ..finding import Quantity
from ..observations.wrench import WrenchObservation
from ..terms.preload import profile


def as_effect(word: str, place: Where, parameters: Mapping[str, Quantity]) -> Effect:
    """The effect that a chain runs: within the law's bounds, shares that sum to no more than can be undone."""
    values = {name: np.clip(q.value, *_bounds(word, name)) for name, q in parameters.items()}
    for name in ("a", "w"):
        if np.ndim(values.get(name, 0.0)):
            values[name] = values[name] * min(1.0, MOST_SHARED / max(float(np.sum(values[name])), 1e-9))
    return effect(word, place, **values)


def effect_of(word: str, where: Where, parameters: Mapping[str, Quantity], seen: WrenchObservation) -> Effect | None:
    """As a chain runs it; None where there is no law, or its values lie beyond what can be undone."""
    if word not in laws():
        return None
    named = {each.name for each in laws()[word].parameters}
    own = {name: quantity for name, quantity in parameters.items() if name in named}
    if word == "swapped_triangles":
        own["pair"] = Quantity([list(identity) for identity in where.ids], np.zeros((2, 2)), "1")
    if word == "drift":
        own["t_s"] = replace(own["t_s"], value=[float(t) for t in own["t_s"].value])
    try:
        found = as_effect(word, where, own)
    except EffectError:
        return None
    highest = float(np.ceil(seen.pressure_pa.max()))
    return replace(found, valid_range={"pressure_pa": (0.0, highest)}) if found.law.domain == "pressure" else found


def preloads(where: Where, shares: Array, seen: WrenchObservation) -> list[Effect]:
    """One on every triangle at `where`: straps press more under them than elsewhere. `shares` of `terms.preload`."""
    rows = np.unique(where.slots(seen.layout) // N_TAXELS)
    p0_pa = profile(seen.layout, shares)
    places = [(Where("triangle", (tuple(seen.layout.identities[row].tolist()),)), p0_pa[row]) for row in rows]
    found = [effect_of("preload", place, {"p0_pa": Quantity(float(value), 0.0, "Pa")}, seen) for place, value in places]
    return [each for each in found if each is not None]


def _bounds(word: str, name: str) -> tuple[float, float]:
    parameter = next(each for each in laws()[word].parameters if each.name == name)
    return parameter.low, parameter.high
