"""Describe each finding in one sentence: where, what, and how much."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..physics.effect import Where
from .finding import Quantity
from .places import place_in_words
from .terms.snap import TOGETHER

IN_WORDS = {"1": "", "count": "counts", "count/K": "counts a kelvin", "1/K": "a kelvin"}
SHOWN = 5  # values of a list; of a longer one the range is stated
SUFFIXES = ("_pa", "_s", "_count", "_n", "_c", "_m")  # of a name that repeat the unit


def of_effect(word: str, where: Where, parameters: Mapping[str, Quantity]) -> str:
    """Return the sentence of an effect with its parameters."""
    if word == "temperature" and not parameters:
        return (
            f"{place_in_words(where)}: temperature, by the thermal pads. Record temperature_c in the reference to have "
            "it in kelvins and in the model."
        )
    stated = {name: q for name, q in parameters.items() if name not in ("pair", TOGETHER) and _is_stated(name, q)}
    numbers = ", ".join(_number(name, q) for name, q in stated.items())
    how = ", the taxels of a triangle together" if TOGETHER in parameters else ""
    return f"{place_in_words(where)}: {word.replace('_', ' ')}{f' ({numbers})' if numbers else ''}{how}."


def of_constant(offset: Sequence[float]) -> str:
    """Return the sentence of a constant offset of the reference."""
    return (
        f"The reference reads {offset[0]:+.1f} N, {offset[1]:+.2f} and {offset[2]:+.2f} N·m at all times, loaded or "
        "not: zero it, or take the baseline of the insole anew."
    )


def _is_stated(name: str, quantity: Quantity) -> bool:
    """Return whether a parameter is stated; the times of a long course are not."""
    return name != "t_s" or np.size(quantity.value) <= SHOWN


def _number(name: str, quantity: Quantity) -> str:
    values = np.asarray(quantity.value, float)
    unit = IN_WORDS.get(quantity.unit, quantity.unit)
    if quantity.unit == "Pa":
        values, unit = values * 1e-3, "kPa"
    suffix = next((ending for ending in SUFFIXES if name.endswith(ending)), "")
    called = "share of the range" if name == "amplitude_fraction" else name.removesuffix(suffix).replace("_", " ")
    return f"{called} {_plain(values)} {unit}".strip()


def _plain(values: Any) -> str:
    if np.ndim(values) == 0:
        return f"{float(values):.3g}"
    flat = np.ravel(values)
    if flat.size > SHOWN:
        return f"from {flat.min():.3g} to {flat.max():.3g}"
    return ", ".join(f"{float(value):.3g}" for value in flat)
