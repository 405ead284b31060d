"""What no known effect explains, put together from pieces of memory: an equation, its place in the load, a reading.

The pieces are looked for one after the other (orthogonal matching pursuit: Pati, Rezaiifar & Krishnaprasad, 27th
Asilomar Conf. (1993) 40), each admitted only for what it explains on blocks that were held out. What they are called
is a proposal: the equation says what the readings do, not why.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..physics.law import Array
from .evidence import Group
from .fit import Fitted, Hypothesis, within
from .naming import N_FOLDS, folds
from .observed import Load
from .operators import low_pass, plays, relay

MOST_ATOMS = 3
WORTH = 0.1  # natural logarithm of the held-out mean square: what one more piece has to gain
RATE_S = 0.2
LEVELS = 3


@dataclass(frozen=True, slots=True, eq=False)
class Discovered:
    """An equation that is left when no name fits."""

    equation: str  # empty where not even pieces explain anything
    explained: float  # of what the static model leaves above the noise, on held-out blocks
    regime: Mapping[str, Any]  # where in the load most of it is


def discover(group: Group, null: Fitted) -> Discovered:
    """Pieces that explain what `null`, the static model fitted to the group's evidence, leaves."""
    evidence = group.evidence
    hypothesis = Hypothesis(evidence, ())
    slope = hypothesis.slope(null)
    basis = np.linalg.qr(null.design)[0]
    names, directions = [], []
    span = max(float(np.ptp(each.load.pressure_pa)) for each in evidence.observed)
    for name, of_load in _atoms(span).items():
        blocks = [each.load.means(of_load(each.load), each.reference_s(each.edge_s)) for each in evidence.observed]
        direction = slope * np.concatenate(blocks)
        direction -= within(basis, direction)
        if np.sum(direction**2) > 0:
            names.append(name)
            directions.append(direction)
    every, fold = np.stack(directions), folds(evidence)
    chosen: list[int] = []
    left = _held_out(every[[]], null.residual, fold)
    first = left
    while len(chosen) < MOST_ATOMS:
        rest = null.residual - _fitted(every[chosen], null.residual, np.ones(len(fold), bool))
        promise = np.einsum("jnr,nr->j", every, rest) ** 2 / np.einsum("jnr,jnr->j", every, every)
        promise[chosen] = -1.0
        best = int(promise.argmax())
        after = _held_out(every[[*chosen, best]], null.residual, fold)
        if np.log(left / max(after, 1e-300)) < WORTH:
            break
        chosen, left = [*chosen, best], after
    weights = _weights(every[chosen], null.residual, np.ones(len(fold), bool))
    terms = [f"{weight * scale:+.3g}{unit}·{names[i][0]}" for weight, i in zip(weights, chosen, strict=True)
             for scale, unit in [names[i][1]]]  # fmt: skip
    above = max(first - group.floor, 1e-12)
    equation = "q = P " + " ".join(terms) if terms else ""
    return Discovered(equation, float(np.clip((first - left) / above, 0.0, 1.0)), _regime(group, null))


def _atoms(span: float) -> dict[tuple[str, tuple[float, str]], Any]:
    """Pieces of memory by what they are called and (scale, unit) of their weight; each makes (N, m) of a load."""
    made: dict[tuple[str, tuple[float, str]], Any] = {}
    for up in np.geomspace(0.05, 0.9, 10):
        for gap in (0.2, 0.5, 0.8):
            high, low = up * span, up * (1 - gap) * span
            name = f"[P has passed {high / 1e3:.0f} kPa and not fallen below {low / 1e3:.0f} kPa since]"
            made[name, (1e-3, " kPa")] = lambda load, a=high, b=low: relay(load.pressure_pa, a, b)
    for tau in np.geomspace(0.1, 200.0, 12):
        made[f"(mean of the last {tau:.2g} s − P)", (1.0, "")] = lambda load, t=tau: (
            low_pass(load.pressure_pa, load.step_s, t) - load.pressure_pa
        )
        made[f"P·(mean of the last {tau:.2g} s)/kPa", (1e3, "")] = lambda load, t=tau: (
            load.pressure_pa * low_pass(load.pressure_pa, load.step_s, t)
        )
    for radius in (0.02, 0.06, 0.15, 0.35):
        made[f"(play of {radius * span / 1e3:.0f} kPa − P)", (1.0, "")] = lambda load, r=radius * span: plays(
            load.pressure_pa, np.array([r])
        )[0]
    made["|dP/dt|·s", (1.0, "")] = lambda load: np.abs(_rate(load))
    made["P·|dP/dt|·s/kPa", (1e3, "")] = lambda load: load.pressure_pa * np.abs(_rate(load))
    made["P·[loading]", (1.0, "")] = lambda load: load.pressure_pa * (_rate(load) > 0.01 * span)
    made["P·t/s", (1.0, "")] = lambda load: load.pressure_pa * (load.t_s - load.start_s)[:, None]
    return made


def _rate(load: Load) -> Array:
    """(N, m) Pa/s of the load, over RATE_S."""
    return np.gradient(low_pass(load.pressure_pa, load.step_s, RATE_S), load.step_s, axis=0)


def _weights(directions: Array, residual: Array, rows: NDArray[np.bool_]) -> Array:
    design = directions[:, rows].reshape(len(directions), rows.sum() * residual.shape[1]).T
    return np.asarray(np.linalg.lstsq(design, residual[rows].ravel(), rcond=None)[0])


def _fitted(directions: Array, residual: Array, rows: NDArray[np.bool_]) -> Array:
    found: Array = np.einsum("j,jnr->nr", _weights(directions, residual, rows), directions)
    return found


def _held_out(directions: Array, residual: Array, fold: NDArray[np.intp]) -> float:
    total = 0.0
    for i in range(N_FOLDS):
        out = fold == i
        total += float(np.sum((residual - _fitted(directions, residual, ~out))[out] ** 2))
    return total / residual.size


def _regime(group: Group, null: Fitted) -> dict[str, Any]:
    """The third of the load's range, and the way it moves, with the largest mean square."""
    load = null.effective_pa.mean(axis=1)
    edges = np.linspace(load.min(), load.max(), LEVELS + 1)
    level = np.clip(np.digitize(load, edges) - 1, 0, LEVELS - 1)
    rising = np.gradient(load) > 0
    square = np.sum(null.residual**2, axis=1)
    found = []
    for at in range(LEVELS):
        for phase, way in (("loading", rising), ("unloading", ~rising)):
            rows = (level == at) & way
            if rows.sum() > 20:
                found.append((float(square[rows].mean()), at, phase))
    if not found:
        return {}
    _, at, phase = max(found)
    return {"pressure_pa": [round(float(edges[at])), round(float(edges[at + 1]))], "phase": phase}
