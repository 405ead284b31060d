"""Parameters of the laws of selected effects, with standard deviations."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..physics.effects import laws
from ..recording.loading import FootRecording
from .finding import Quantity
from .model.refine import Refined
from .select.amplitude import amplitude_fraction

LOOPS = ("viscoelasticity", "creep", "hysteresis")
MISFIT_OF_VALUES = 0.05  # of a parameter: materials follow a law only approximately


def parameters_of(refined: Refined[Any], i: int, foot: FootRecording) -> dict[str, Quantity]:
    """Return the law's parameters of candidate `i` with standard deviations, from the regression's covariance.

    Empty for a temperature that is known only from the thermal pads, whose counts per kelvin are not known.
    """
    law = refined.of_laws
    inner, candidate = law.design, law.design.candidates[i]
    if candidate.word == "temperature" and inner.load.observation.temperature_is_in_counts:
        return {}
    shares = law.shares[i]
    mapping = candidate.term.parameters_of(inner.load.observation.load_is_known or candidate.term.is_of_load)
    values = mapping(candidate.settings, shares)
    units = {p.name: p.unit for p in laws()[candidate.word].parameters} if candidate.word in laws() else {}
    columns = candidate.columns
    covariance = np.linalg.pinv(inner.gram[:, :] + np.diag(1e-9 * inner.gram.diagonal() + 1e-12))
    std = np.sqrt(np.maximum(np.diag(covariance)[columns], 0.0))
    spread = {name: np.zeros_like(np.asarray(value, float)) for name, value in values.items()}
    if candidate.term.share != "whole":
        for k in range(len(shares)):
            nudged = shares.copy()
            nudged[k] += std[k]
            for name, value in mapping(candidate.settings, nudged).items():
                if np.size(np.asarray(value, float)) == np.size(np.asarray(values[name], float)):
                    spread[name] = spread[name] + (np.asarray(value, float) - np.asarray(values[name], float)) ** 2
    quantities = {}
    for name, value in values.items():
        size = np.asarray(value, float)
        relative = 0.0 if candidate.word == "bit_shift" or name in ("t_s",) else MISFIT_OF_VALUES
        scale = np.abs(size - 1.0) if name in ("gain", "scale") else np.abs(size)
        quantities[name] = Quantity(value, np.sqrt(spread[name] + (relative * scale) ** 2), units.get(name, "1"))
    if candidate.word in LOOPS:
        quantities["amplitude_fraction"] = amplitude_fraction(refined, i)
    if candidate.word == "bit_shift":
        known = {board.address: board.shift for board in foot.boards}
        believed = known.get(candidate.where.ids[0][0]) if candidate.where.ids else next(iter(known.values()))
        step = int(values["shift"])
        quantities["shift"] = Quantity((believed or 0) + step, 0.0, "1")
    if candidate.word == "temperature":
        temperature = inner.load.observation.temperature_c
        assert temperature is not None
        quantities["t0_c"] = Quantity(float(temperature.mean()), 0.0, "°C")
    return quantities
