"""What was found in the words of a chain that runs it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...physics.effect import Effect, Where, effect
from ...physics.effects import laws
from ...physics.law import MOST_SHARED
from ..finding import Quantity


def as_effect(word: str, place: Where, parameters: Mapping[str, Quantity]) -> Effect:
    """The effect that a chain runs: within the law's bounds, shares that sum to no more than can be undone."""
    values = {name: np.clip(q.value, *_bounds(word, name)) for name, q in parameters.items()}
    for name in ("a", "w"):
        if np.ndim(values.get(name, 0.0)):
            values[name] = values[name] * min(1.0, MOST_SHARED / max(float(np.sum(values[name])), 1e-9))
    return effect(word, place, **values)


def _bounds(word: str, name: str) -> tuple[float, float]:
    parameter = next(each for each in laws()[word].parameters if each.name == name)
    return parameter.low, parameter.high
