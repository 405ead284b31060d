"""The static model as it was handed in: how far off it is on the data, and what of that the sensor had already then.

A calibration is made of the sensor as it is. With a memory in it, the curve it holds is the best static curve through
the loops; made at some temperature, it is right at that one. Between the curve without effects, which a diagnosis fits,
and the one that was handed in lie components that are no change of the sensor:

    handed in ≈ fitted + Σ s_k · component_k

- memory: the best static curve of the data less the fitted one, 0 (every level was waited for) to 1 (this routine);
- drift: the mean of what it adds, 0 to 1;
- temperature: what a kelvin does, from the coldest to the warmest at which calibrations are made.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from ..physics.calibration import Calibration
from ..physics.curve_inverse import CurveInverse
from ..physics.law import Array
from .evidence import Taxels, gather
from .explained import Explained, Insole, curves_of
from .fit import Evidence, Hypothesis
from .floor import noise_of_blocks
from .groups import Located
from .modelling import Curves

SIGMAS = 3.0  # of a reading's noise, by which it is within the range
ROOMS_C = (15.0, 35.0)  # at which calibrations are made, beside the recording's own temperatures


@dataclass(frozen=True, slots=True, eq=False)
class Component:
    """What a calibration of the sensor with an effect may hold: `low` to `high` times `more` less `less`."""

    effect: str
    more: Curves
    less: Curves | None  # None: the fitted curves
    low: float
    high: float


def listed(model: Calibration, slots: NDArray[np.intp]) -> NDArray[np.bool_]:
    """(m,) which of the `slots` have a curve of `model` that rises."""
    coefficients = model.coefficients_pa.reshape(-1, model.coefficients_pa.shape[-1])[slots]
    rises = coefficients[:, 1] > 0 if coefficients.shape[1] > 1 else np.zeros(len(slots), np.bool_)
    found: NDArray[np.bool_] = model.usable.ravel()[slots] & rises
    return found


def activation(model: Calibration, slots: NDArray[np.intp], load_pa: Array) -> Array:
    """(n, m) activation that `model` expects of the taxels `slots` (m,), all listed, under `load_pa` (n, m)."""
    coefficients = model.coefficients_pa.reshape(-1, model.coefficients_pa.shape[-1])[slots]
    return CurveInverse(coefficients)(load_pa)


def mismatch(taxels: Taxels, theta: Array, model: Calibration) -> float:
    """Mean square above the noise, counts², by which readings differ from `model` with the clocks at `theta`."""
    known = listed(model, taxels.slots)
    if not known.any():
        return 0.0
    own = taxels.some(known)
    evidence = gather(own, np.empty((sum(len(each.first) for each in own.observed), 0))).taxels
    load_pa = np.broadcast_to(Hypothesis(evidence, ()).effective_pa(theta), evidence.y.shape)
    expected = model.baseline_count.ravel()[own.slots] - activation(model, own.slots, load_pa)
    count, margin = -evidence.y * own.noise_count, SIGMAS * own.noise_count
    # Beyond the ends of its range a taxel's readings are a guess.
    within = (expected > margin) & (expected < 255.0 - margin)
    ends = np.cumsum([len(each.first) for each in own.observed])[:-1]
    noise = np.mean([noise_of_blocks(part) ** 2 for part in np.split(count, ends)], axis=0)
    above = np.where(within, (count - expected) ** 2 - noise, 0.0)
    return max(float(above.sum() / max(np.count_nonzero(within), 1)), 0.0)


def components(insole: Insole, located: Located, explained: Explained) -> list[Component]:
    """What a calibration of the sensor with the effects that explain it may hold beside the fitted curves."""
    if not any(decided.best.words for _, decided in explained):
        return []
    brought, per_kelvin, warm = np.zeros_like(located.taxels.y), np.zeros_like(located.taxels.y), False
    for named, decided in explained:
        own = np.searchsorted(located.slots, named.group.slots)
        hypothesis = Hypothesis(named.group.taxels, decided.best.fitted.candidates)
        fitted = hypothesis.at(decided.best.fitted.theta)
        for word, added in hypothesis.brought_by(fitted).items():
            brought[:, own] += added
            if word == "temperature":
                warm = True
                offset, slope = hypothesis.shares_of(fitted)[word]
                per_kelvin[:, own] += offset + slope * (1.0 + hypothesis.position(fitted.effective_pa))

    def curves(evidence: Evidence) -> Curves:
        return curves_of(Hypothesis(evidence, ()), located.null.theta, located.slots, insole)

    still, whole = curves(located.taxels.of(located.taxels.y - brought)), curves(located.taxels)
    found = [Component("memory", still, None, 0.0, 1.0), Component("drift", whole, still, 0.0, 1.0)]
    if warm:
        were = [each.temperature_c for each in located.taxels.observed if each.temperature_c is not None]
        temperature_c, zero_c = np.concatenate([np.array(ROOMS_C), *were]), insole.excitation.temperature_c
        kelvin = curves(located.taxels.of(located.taxels.y + per_kelvin))
        low, high = float(temperature_c.min()) - zero_c, float(temperature_c.max()) - zero_c
        found.append(Component("temperature", kelvin, whole, low, high))
    return found


def absorbed(fitted: Array, believed: Array, parts: list[tuple[Array, float, float]]) -> Array:
    """(m, g) what brings the `fitted` curves nearest to the `believed`, of the parts (m, g) within their bounds."""
    moves = [(part, low, high) for part, low, high in parts if np.abs(part).max() > 1e-9 and high > low]
    if not moves:
        return np.zeros_like(fitted)
    design = np.stack([part.ravel() for part, _, _ in moves], axis=1)
    bounds = np.array([[low, high] for _, low, high in moves]).T
    share = lsq_linear(design, (believed - fitted).ravel(), (bounds[0], bounds[1])).x
    found: Array = (design @ share).reshape(fitted.shape)
    return found
