"""Parameters of the laws of selected effects, with standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..physics.effects import laws
from ..recording.loading import FootRecording
from .finding import Quantity
from .model.refine import Refined
from .select.amplitude import amplitude_fraction
from .terms import creep_by_reference, mean_curve
from .terms.term import Setting

LOOPS = ("viscoelasticity", "creep", "hysteresis")  # effects with an `amplitude_fraction`
MISFIT_OF_VALUES = 0.05  # relative: materials follow a law only approximately
LEAST_RATIO = 0.2  # of a pressure by corrected curves to that by those handed in
MISFIT_OF = {"map_transform": 0.1}  # of single effects: a simulated load is not that of the person


def parameters_of(refined: Refined[Any], i: int, foot: FootRecording) -> dict[str, Quantity]:
    """Return the parameters of the law of candidate `i`, by name, with standard deviations.

    A standard deviation combines the covariance of the regression, propagated by finite differences, and MISFIT_OF the
    effect or MISFIT_OF_VALUES. A temperature that is known only in counts of the thermal pads has no parameters.
    """
    law = refined.of_laws
    design, candidate = law.design, law.design.candidates[i]
    if candidate.word == "temperature" and design.load.observation.temperature_is_in_counts:
        return {}
    mapping = candidate.term.parameters_of(design.load.observation.load_is_known or candidate.term.is_of_load)
    settings, per_share, absorbed_pa = _of_corrected_curves(law, i)
    shares = per_share * law.shares[i]
    values = mapping(settings, shares)
    units = {p.name: p.unit for p in laws()[candidate.word].parameters} if candidate.word in laws() else {}
    columns = candidate.columns
    covariance = np.linalg.pinv(design.gram[:, :] + np.diag(1e-9 * design.gram.diagonal() + 1e-12))
    std = per_share * np.sqrt(np.maximum(np.diag(covariance)[columns], 0.0))
    variance = {name: np.zeros_like(np.asarray(value, float)) for name, value in values.items()}
    if candidate.term.share != "whole":
        for k in range(len(shares)):
            shifted = shares.copy()
            shifted[k] += std[k]
            for name, value in mapping(settings, shifted).items():
                if np.size(value) == np.size(values.get(name, ())):  # else the shares decide what is kept
                    variance[name] = variance[name] + (np.asarray(value, float) - np.asarray(values[name], float)) ** 2
    quantities = {}
    for name, value in values.items():
        numbers = np.asarray(value, float)
        std = np.hypot(np.sqrt(variance[name]), absorbed_pa)
        if name == "t_s":  # of an event between two readings
            std = np.maximum(std, design.load.step_s)
        elif candidate.word != "bit_shift":
            std = with_misfit(name, numbers, std, MISFIT_OF.get(candidate.word, MISFIT_OF_VALUES))
        quantities[name] = Quantity(value, std, units.get(name, "1"))
    if candidate.word in LOOPS:
        quantities["amplitude_fraction"] = amplitude_fraction(refined, i)
    if candidate.word == "bit_shift":
        shift_of_board = {board.address: board.shift for board in foot.boards}
        configured = (
            shift_of_board.get(candidate.where.ids[0][0])
            if candidate.where.ids
            else next(iter(shift_of_board.values()))
        )
        bits = int(values["shift"])
        quantities["shift"] = Quantity((configured or 0) + bits, 0.0, "1")
    if candidate.word == "temperature":
        temperature = design.load.observation.temperature_c
        assert temperature is not None
        quantities["t0_c"] = Quantity(float(temperature.mean()), 0.0, "°C")
    return quantities


def _of_corrected_curves(law: Refined[Any], i: int) -> tuple[Sequence[Setting], float, float]:
    """Return the settings of candidate `i` of a refined set, a factor of its shares, and a standard deviation, Pa.

    On a walk, settings and shares are fitted to pressures by the curves handed in. These may contain the mean curve of
    the effect, so they are corrected. With κ, the ratio of corrected pressures to those handed in, a play of radius r
    and share b is one of radius κ·r and share b/κ. Thresholds of a snap are corrected one by one, and are uncertain by
    as much, as is its step. Of a reference F, readings show (1 − c)·F − Σ a·(F − z): by curves corrected for c, the
    shares are a/(1 − c).
    """
    design, candidate = law.design, law.design.candidates[i]
    if design.load.is_known or not candidate.term.is_loop:
        return candidate.settings, 1.0, 0.0
    shares = {  # 0 of terms of the set itself
        word: np.array([law.companion_shares.get(column, 0.0) for column in candidate.companions_of(word)])
        for word in candidate.term.absorbs
    }
    if candidate.term.is_of_load:
        return candidate.settings, 1.0 / (1.0 - float(shares[creep_by_reference.CALIBRATED].sum())), 0.0
    knots_pa = mean_curve.knots_pa(design.load)
    if candidate.word == "snap":
        names = tuple(candidate.settings[0])
        by_curves_pa = np.array([candidate.settings[0][name] for name in names])
        change_pa = mean_curve.change_by_all_pa(by_curves_pa, knots_pa, shares)
        corrected_pa = np.maximum(by_curves_pa + change_pa, 0.0).tolist()
        return (dict(zip(names, corrected_pa, strict=True)),), 1.0, float(np.abs(change_pa).max())
    slots = candidate.where.slots(design.load.observation.layout)
    pressure_pa = design.load.pressure_pa.reshape(len(design.weights), -1)[:, slots]
    change_pa = mean_curve.change_by_all_pa(pressure_pa, knots_pa, shares)
    ratio = max(1.0 + float(np.sum(change_pa * pressure_pa) / np.sum(pressure_pa**2)), LEAST_RATIO)
    settings = [
        {name: ratio * value if name.endswith("_pa") else value for name, value in setting.items()}
        for setting in candidate.settings
    ]
    return settings, 1.0 / ratio, 0.0


def with_misfit(name: str, value: Any, std: Any, misfit: float = MISFIT_OF_VALUES) -> Any:
    """Return the standard deviation of the parameter `name` with the relative `misfit` of its value."""
    change = np.abs(value - 1.0) if name in ("gain", "scale") else np.abs(value)
    return np.sqrt(std**2 + (misfit * change) ** 2)
