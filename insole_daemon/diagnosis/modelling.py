"""What was found as a model that others can use: effects in the format's words, and the curves fitted with them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import Foot
from ..physics import effects_document
from ..physics.calibration import Calibration
from ..physics.effect import Effect, Where, effect
from ..physics.effects import laws
from ..physics.law import MOST_SHARED, Array
from ..skin.geometry import N_TAXELS
from ..skin.layout import Layout
from .candidate import Candidate, Excitation
from .candidates.drift import knots_s
from .finding import Quantity
from .fit import Fitted, Hypothesis

# Of a parameter: what it is off by where materials of other families were concealed (benchmarks/diagnosis/families.py).
FAMILY = 0.05
FAMILIES = {"step_pa": 0.3, "amplitude_fraction": 0.08}  # a snap that domains spread out loses most of its edges
MOST_DEGREE = 11  # of the curve back from activation to pressure, in the file
NEAR_COUNT = 0.05  # RMS: a polynomial that says so nearly what the curve says is enough
BEYOND = np.linspace(0.01, 0.1, 10)  # of the range: over so much it goes on straight at either end
FLAT = 0.02  # of the usual slope: flatter, and a reading tells next to nothing of the load
N_LOADS = 200


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """Of m taxels: what they read at g effective loads, all effects left out."""

    slots: NDArray[np.intp]
    load_pa: Array  # (g,)
    activation_count: Array  # (m, g) less the baseline that counts were turned round about, 0


def quantities(
    candidate: Candidate, values: Array, std: Array, hypothesis: Hypothesis, fitted: Fitted,
    noise_count: Array, excitation: Excitation, seconds: float,
) -> dict[str, Quantity]:  # fmt: skip
    """The parameters of one effect in the format's words.

    `fitted` to m taxels, `noise_count` (m,) theirs; `seconds` of the first recording. To what the folds show comes what
    they cannot: that the material is of another family than the curve fitted to it, and taxels differ.
    """
    found = _fitted_quantities(candidate, values, std, hypothesis, fitted, noise_count, excitation, seconds)
    return {
        name: replace(q, std=np.hypot(q.std, FAMILIES.get(name, FAMILY) * np.abs(q.value)))
        if name not in ("t_s", "t0_c")
        else q
        for name, q in found.items()
    }


def _fitted_quantities(
    candidate: Candidate, values: Array, std: Array, hypothesis: Hypothesis, fitted: Fitted,
    noise_count: Array, excitation: Excitation, seconds: float,
) -> dict[str, Quantity]:  # fmt: skip
    """As `quantities`, with what the folds show alone."""
    units = {parameter.name: parameter.unit for parameter in laws()[candidate.word].parameters}
    if candidate.parameters is not None:
        middle = candidate.parameters(values)
        spread = {name: np.zeros_like(np.asarray(value, float)) for name, value in middle.items()}
        for j in range(len(values)):
            nudged = np.clip(values + np.eye(len(values))[j] * max(std[j], 1e-9), candidate.low, candidate.high)
            for name, value in candidate.parameters(nudged).items():
                if np.shape(value) == np.shape(middle[name]):
                    spread[name] += (np.asarray(value, float) - middle[name]) ** 2
        return {name: Quantity(value, np.sqrt(spread[name]), units[name]) for name, value in middle.items()}
    shares = hypothesis.shares_of(fitted)[candidate.word] * noise_count  # (k, m) in counts of activation
    if candidate.word == "drift":
        shift = -np.median(shares, axis=1)
        scatter = 1.4826 * np.median(np.abs(shares + shift[:, None]), axis=1) / np.sqrt(shares.shape[1])
        knots = knots_s(seconds)
        return {
            "t_s": Quantity(knots, np.zeros_like(knots), "s"),
            "shift_count": Quantity(np.append(0.0, shift), np.append(0.0, scatter), "count"),
        }
    x = np.linspace(0.0, 2.0, 30)
    loads = hypothesis.load_at(x - 1.0)
    activation = hypothesis.curve(fitted, loads) * noise_count[:, None]
    activation = activation - activation[:, :1]
    per_kelvin = shares[0][:, None] + shares[1][:, None] * x
    design = np.stack([activation, -np.ones_like(activation)], axis=-1)
    solved = np.stack([np.linalg.lstsq(d, p, rcond=None)[0] for d, p in zip(design, per_kelvin, strict=True)])
    gain, count = np.median(solved, axis=0)
    spread = 1.4826 * np.median(np.abs(solved - [gain, count]), axis=0) / np.sqrt(len(solved))
    return {
        "count_per_k": Quantity(count, spread[1], units["count_per_k"]),
        "gain_per_k": Quantity(gain, spread[0], units["gain_per_k"]),
        "t0_c": Quantity(excitation.temperature_c, 0.0, units["t0_c"]),
    }


def as_effect(word: str, place: Where, parameters: Mapping[str, Quantity]) -> Effect:
    """The effect that a chain runs: within the law's bounds, shares that sum to no more than can be undone."""
    values = {name: np.clip(q.value, *_bounds(word, name)) for name, q in parameters.items()}
    for name in ("a", "w"):
        if np.ndim(values.get(name, 0.0)):
            values[name] = values[name] * min(1.0, MOST_SHARED / max(float(np.sum(values[name])), 1e-9))
    return effect(word, place, **values)


def document(
    foot: Foot, layout: Layout, curves: Sequence[Curves], effects: Sequence[Effect], provenance: Mapping[str, Any]
) -> dict[str, Any]:
    """An `insole-calibration/1` that holds them; the baselines are what the curves say without load.

    Effects of the load are valid as far as the curves were seen.
    """
    seen_pa = [float(load) for each in curves for load in each.load_pa[[0, -1]]]
    effects = [
        replace(each, valid_range={"pressure_pa": (min(seen_pa), max(seen_pa))})
        if seen_pa and each.law.domain == "pressure" and not each.valid_range
        else each
        for each in effects
    ]
    taxels = []
    identities = layout.identities.tolist()
    for slot, baseline, coefficients in _polynomials(curves):
        board, triangle = identities[slot // N_TAXELS]
        taxels.append(
            {"board": board, "triangle": triangle, "taxel": slot % N_TAXELS,
             "baseline_count": round(baseline, 4), "coefficients_pa": [float(f"{c:.9g}") for c in coefficients]}
        )  # fmt: skip
    taxels.sort(key=lambda each: (each["board"], each["triangle"], each["taxel"]))
    return {
        "format": "insole-calibration/1", "foot": foot, "taxels": taxels,
        "effects": effects_document.document(effects, layout), "provenance": dict(provenance),
    }  # fmt: skip


def static(foot: Foot, layout: Layout, curves: Sequence[Curves]) -> Calibration:
    """The curves alone, as what pressures are told by."""
    told = list(_polynomials(curves))
    k = max(len(coefficients) for _, _, coefficients in told)
    baseline = np.full(len(layout) * N_TAXELS, np.nan)
    rows = np.full((len(baseline), k), np.nan)
    for slot, rest, coefficients in told:
        baseline[slot] = rest
        rows[slot] = np.pad(coefficients, (0, k - len(coefficients)))
    shape = (len(layout), N_TAXELS)
    usable = ~np.isnan(baseline)
    return Calibration(foot, baseline.reshape(shape), rows.reshape(*shape, k), None, usable.reshape(shape), {})


def _polynomials(curves: Sequence[Curves]) -> Iterable[tuple[int, float, Array]]:
    """Of every taxel its slot, its baseline and its coefficients."""
    for each in curves:
        for slot, activation in zip(each.slots.tolist(), each.activation_count, strict=True):
            baseline = -float(np.interp(0.0, each.load_pa, activation))
            yield slot, baseline, _back(activation + baseline, each.load_pa)


def _back(activation: Array, load_pa: Array) -> Array:
    """(k,) coefficients of the load as a polynomial of the activation, rising as a chain needs it.

    What it is off counts as it would be read: where the curve is flat, as beyond a knee, a pascal is little.
    """
    slope = np.gradient(activation, load_pa)
    slope = np.maximum(slope, FLAT * max(float(np.ptp(activation)), 1e-9) / float(np.ptp(load_pa)))
    more = BEYOND * float(np.ptp(load_pa))
    ends = [(load_pa[0] - more[::-1], activation[0] - more[::-1] * slope[0]),
            (load_pa, activation),
            (load_pa[-1] + more, activation[-1] + more * slope[-1])]  # fmt: skip
    load, read = (np.concatenate(each) for each in zip(*ends, strict=True))
    weight = np.concatenate([np.full(len(more), slope[0]), slope, np.full(len(more), slope[-1])])
    scale = max(float(np.abs(read).max()), 1e-9)
    grid = np.linspace(float(read.min()), float(read.max()), 200) / scale
    best, nearest = np.array([0.0, max(float(load_pa[-1]), 1.0) / scale]), np.inf
    for degree in range(1, MOST_DEGREE + 1):
        powers = np.vander(read / scale, degree + 1, increasing=True)
        found = np.linalg.lstsq(powers * weight[:, None], load * weight, rcond=None)[0]
        rises = np.polynomial.polynomial.polyval(grid, found[1:] * np.arange(1, degree + 1)) > 0
        off = float(np.sqrt(np.mean(((powers @ found - load) * weight) ** 2)))
        if rises.all() and off < nearest:
            best, nearest = found / scale ** np.arange(degree + 1), off
        if nearest < NEAR_COUNT:
            break
    return best


def _bounds(word: str, name: str) -> tuple[float, float]:
    parameter = next(each for each in laws()[word].parameters if each.name == name)
    return parameter.low, parameter.high
