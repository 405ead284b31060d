"""Convert findings to effects of a chain."""

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
    """Return the effect of a chain: parameters within the law's bounds, shares limited to a sum that can be undone."""
    values = {name: np.clip(q.value, *_bounds(word, name)) for name, q in parameters.items()}
    for name in ("a", "w"):
        if np.ndim(values.get(name, 0.0)):
            values[name] = values[name] * min(1.0, MOST_SHARED / max(float(np.sum(values[name])), 1e-9))
    return effect(word, place, **values)


def effect_of(word: str, where: Where, parameters: Mapping[str, Quantity], seen: WrenchObservation) -> Effect | None:
    """Return the effect of a chain; None if the word has no law, or its values cannot be undone."""
    if word not in laws():
        return None
    named = {parameter.name for parameter in laws()[word].parameters}
    of_law = {name: quantity for name, quantity in parameters.items() if name in named}
    if word == "swapped_triangles":
        of_law["pair"] = Quantity([list(identity) for identity in where.ids], np.zeros((2, 2)), "1")
    if word == "drift":
        of_law["t_s"] = replace(of_law["t_s"], value=[float(t) for t in of_law["t_s"].value])
    try:
        chained = as_effect(word, where, of_law)
    except EffectError:
        return None
    highest = float(np.ceil(seen.pressure_pa.max()))
    return (
        replace(chained, valid_range={"pressure_pa": (0.0, highest)}) if chained.law.domain == "pressure" else chained
    )


def preloads(where: Where, shares: Array, seen: WrenchObservation) -> list[Effect]:
    """Return a preload for every triangle at `where`, because straps press unevenly; `shares` as in `terms.preload`."""
    rows = np.unique(where.slots(seen.layout) // N_TAXELS)
    p0_pa = profile(seen.layout, shares)
    places = [(Where("triangle", (tuple(seen.layout.identities[row].tolist()),)), p0_pa[row]) for row in rows]
    effects = [
        effect_of("preload", place, {"p0_pa": Quantity(float(value), 0.0, "Pa")}, seen) for place, value in places
    ]
    return [made for made in effects if made is not None]


def _bounds(word: str, name: str) -> tuple[float, float]:
    parameter = next(known for known in laws()[word].parameters if known.name == name)
    return parameter.low, parameter.high
